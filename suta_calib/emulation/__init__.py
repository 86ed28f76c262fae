"""An emulated arm: everything a passive arm on a serial cable does, without the arm.

A *motion* says what the joints truly do, a *stream* turns it into the bytes a device would send,
with noise and faults, and a *player* sends them in real time on a pseudo-terminal. `EmulatedArm`
does all of it in a process of its own.

Names are imported when they are first used: that process needs neither CasADi nor Pinocchio.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
