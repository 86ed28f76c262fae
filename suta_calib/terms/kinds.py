"""The kinds of observation, by name. A new one is one new file here, and one line below."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Final

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
    """Kinds by name, each imported when it is asked for: a job rarely has more than one or two."""

    def __getitem__(self, name: str) -> type[Term]:
        if name not in _NAMES:
            raise KeyError(name)
        return _kind(name)

    def __contains__(self, name: object) -> bool:
        return name in _NAMES

    def __iter__(self) -> Iterator[str]:
        return iter(_NAMES)

    def __len__(self) -> int:
        return len(_NAMES)


KINDS: Final = Kinds()


@cache
def _kind(name: str) -> type[Term]:
    home = vars(import_module(f"suta_calib.terms.{name}")).values()
    terms = (each for each in home if isinstance(each, type) and issubclass(each, Term))
    return next(term for term in terms if vars(term).get("kind") == name)


@cache
def every_grouping() -> Mapping[str, tuple[str, ...]]:
    """What a group of samples is called, in any kind, and the label columns that name it."""
    return {noun: columns for kind in KINDS.values() for noun, columns in kind.groupings.items()}


def first_kind(*, artefact: bool) -> type[Term]:
    """The first kind whose tip touches an artefact, or a place without one."""
    touching = (kind for kind in KINDS.values() if kind.medium == "touch")
    return next(kind for kind in touching if kind.needs_artefact == artefact)
