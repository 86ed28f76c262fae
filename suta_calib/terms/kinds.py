"""The kinds of observation, by name: each a file here, found by looking, or an entry point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from typing import Final

from suta_calib.registry import classes_of, other_classes
from suta_calib.terms.term import Term


class Kinds(Mapping[str, type[Term]]):
    """Kinds by name, in the order in which they are offered; then those of other packages.

    Those are entry points in the group ``suta_calib.kinds``.
    """

    def __getitem__(self, name: str) -> type[Term]:
        return self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)

    @cached_property
    def _shipped(self) -> dict[str, type[Term]]:
        kinds = classes_of("suta_calib.terms", Term)
        return dict(sorted(kinds.items(), key=lambda item: item[1].order))

    @property
    def _all(self) -> dict[str, type[Term]]:
        return {**self._shipped, **other_classes("kinds", Term, self._shipped)}


KINDS: Final = Kinds()


@cache
def every_grouping() -> Mapping[str, tuple[str, ...]]:
    """What a group of samples is called, in any kind, and the label columns that name it."""
    return {noun: columns for kind in KINDS.values() for noun, columns in kind.groupings.items()}


def first_kind(*, artefact: bool) -> type[Term]:
    """The first kind whose tip touches an artefact, or a place without one."""
    touching = (kind for kind in KINDS.values() if kind.medium == "touch")
    return next(kind for kind in touching if kind.needs_artefact == artefact)
