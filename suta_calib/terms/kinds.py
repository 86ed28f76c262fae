"""The kinds of observation, by name: a file here and its line below, or an entry point."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Final

from suta_calib.registry import classes_in, other_classes
from suta_calib.terms.term import Term

# The file of each, which is called as the kind is. In the order in which they are offered; where
# one of a sort is needed, the first is taken.
_NAMES: Final = (
    "pairwise_distance",
    "landmark",
    "fixed_point",
    "plane",
    "line",
    "range",
    "tracked_point",
    "hand_eye",
    "camera_view",
)


class Kinds(Mapping[str, type[Term]]):
    """Kinds by name: ours, each imported when it is asked for, then those of other packages.

    Those are entry points in the group ``suta_calib.kinds``. A job rarely has more than two kinds.
    """

    def __getitem__(self, name: str) -> type[Term]:
        return _kind(name) if name in _NAMES else self._others[name]

    def __contains__(self, name: object) -> bool:
        return name in _NAMES or name in self._others

    def __iter__(self) -> Iterator[str]:
        yield from _NAMES
        yield from self._others

    def __len__(self) -> int:
        return len(_NAMES) + len(self._others)

    @property
    def _others(self) -> Mapping[str, type[Term]]:
        return other_classes("kinds", Term, _NAMES)


KINDS: Final = Kinds()


@cache
def _kind(name: str) -> type[Term]:
    return classes_in(f"suta_calib.terms.{name}", Term)[name]


@cache
def every_grouping() -> Mapping[str, tuple[str, ...]]:
    """What a group of samples is called, in any kind, and the label columns that name it."""
    return {noun: columns for kind in KINDS.values() for noun, columns in kind.groupings.items()}


def first_kind(*, artefact: bool) -> type[Term]:
    """The first kind whose tip touches an artefact, or a place without one."""
    touching = (kind for kind in KINDS.values() if kind.medium == "touch")
    return next(kind for kind in touching if kind.needs_artefact == artefact)
