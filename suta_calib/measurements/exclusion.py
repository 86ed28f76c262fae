"""Samples that a job leaves out by name: nothing is excluded silently, and nothing else is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from suta_calib.errors import SamplesError, did_you_mean
from suta_calib.measurements.fields import Field, Fields, Value
from suta_calib.measurements.samples import Samples, joined
from suta_calib.measurements.yaml_file import YamlSection


@dataclass(frozen=True)
class Exclusion:
    """What a row of a job leaves out.

    Attributes:
        names: by level, such as ``landmarks`` or ``rows``, what is left out; a set is
            ``placement/repeat``, a row ``file.csv:line``.
        columns: by level, the label columns whose values, joined by a slash, it names; none for
            rows.
    """

    names: tuple[tuple[str, tuple[str, ...]], ...]
    columns: Mapping[str, tuple[str, ...]]

    def __str__(self) -> str:
        return "; ".join(f"{level} {', '.join(names)}" for level, names in self.names)

    def as_dict(self) -> dict[str, list[str]]:
        """By level."""
        return {level: list(names) for level, names in self.names}

    def remaining(self, samples: Samples) -> Samples:
        """The samples that are left."""
        out = np.zeros(len(samples), dtype=bool)
        for level, names in self.names:
            labels = _labels(samples, level, self.columns[level])
            for name in names:
                matching = (labels == name).any(axis=0)
                if not matching.any():
                    groups = list(dict.fromkeys(labels[-1].tolist()))
                    raise SamplesError(
                        repr(name),
                        f"one of {', '.join(groups[:20])}{', …' if len(groups) > 20 else ''}",
                        where=f"exclude.{level}",
                        hint=did_you_mean(name, groups),
                    )
                out |= matching
        if out.all():
            raise SamplesError(
                f"all {len(samples)} samples excluded",
                "some samples that remain",
                where="exclude",
            )
        return samples.take(~out)


def exclusion_keys(groupings: Mapping[str, tuple[str, ...]]) -> Fields:
    """The keys of an exclusion: its levels, by the label columns that tell groups apart."""
    return Fields(
        *(
            Field(
                f"{noun}s",
                Value("names", YamlSection.texts),
                f"By {'/'.join(columns)}." if columns else "By file and line, such as file.csv:12.",
            )
            for noun, columns in groupings.items()
        )
    )


def read_exclusion(section: YamlSection, groupings: Mapping[str, tuple[str, ...]]) -> Exclusion:
    """The mapping under a job row's key ``exclude``."""
    columns = {f"{noun}s": labels for noun, labels in groupings.items()}
    names = exclusion_keys(groupings).read(section)
    return Exclusion(tuple((level, names[level]) for level in section.data), columns)


def _labels(samples: Samples, level: str, columns: tuple[str, ...]) -> NDArray[np.str_]:
    """(spellings, n) what each sample is called on a level."""
    if not columns:
        return np.array([samples.origin, [PurePath(place).name for place in samples.origin]])
    for column in columns:
        if column not in samples.labels:
            raise SamplesError(
                f"no column {column!r}, which is needed to exclude {level}",
                f"one of {', '.join(samples.labels) or 'rows'}",
                where=f"exclude.{level}",
            )
    return joined(samples.labels, columns)[None]
