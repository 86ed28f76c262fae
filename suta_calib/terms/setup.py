"""What a row of a job says of an observation beside its samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from suta_calib.display import Displayable
from suta_calib.errors import ArtefactError
from suta_calib.measurements import Artefact
from suta_calib.terms.block import Noise
from suta_calib.terms.seating import Seating


@dataclass(frozen=True)
class Setup(Displayable):
    """What a row of a job file can say beside its samples; every kind takes what it needs.

    Attributes:
        artefact: certified landmarks, or None.
        noise, angular_noise: scatter and robustness of lengths and of angles.
        label: tells several instruments, or sockets, of one kind apart.
        seating: what the artefact's sockets leave open, or None.
        settings: what the kind's own keys say, as its `Term.read_settings` has read them.
    """

    artefact: Artefact | None = None
    noise: Noise = field(default_factory=Noise)
    angular_noise: Noise = field(default_factory=Noise)
    label: str = "default"
    seating: Seating | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)

    def certified(self, kind: str) -> Artefact:
        """The artefact, or the error that it is missing."""
        if self.artefact is None:
            raise ArtefactError("no artefact", f"an artefact for {kind}", where=kind)
        return self.artefact
