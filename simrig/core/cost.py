"""What a result cost: samples, simulated hardware time, compute time and bytes; a stopwatch."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class Cost:
    """The price of a result; costs of successive steps add up.

    Attributes:
        samples: BRDF samples taken (distinct physical direction pairs).
        hardware_seconds: simulated time of the measuring device, in seconds.
        compile_seconds: time spent compiling kernels (first call), in seconds.
        compute_seconds: time spent computing once compiled, in seconds.
        bytes: storage of the result, in bytes.
    """

    samples: int = 0
    hardware_seconds: float = 0.0
    compile_seconds: float = 0.0
    compute_seconds: float = 0.0
    bytes: int = 0

    def __add__(self, other: Cost) -> Cost:
        return Cost(
            self.samples + other.samples,
            self.hardware_seconds + other.hardware_seconds,
            self.compile_seconds + other.compile_seconds,
            self.compute_seconds + other.compute_seconds,
            self.bytes + other.bytes,
        )

    @property
    def hardware_hours(self) -> float:
        """Simulated time of the measuring device, in hours."""
        return self.hardware_seconds / 3600.0

    def __str__(self) -> str:
        """Return what there is of it, in words."""
        parts = [
            f"{self.samples:,} samples" if self.samples else "",
            _duration(self.hardware_seconds, " of simulated hardware"),
            _duration(self.compute_seconds, " of computing"),
            _duration(self.compile_seconds, " of compilation"),
            f"{self.bytes:,} bytes" if self.bytes else "",
        ]
        return ", ".join(filter(None, parts)) or "nothing"

    def as_dict(self) -> dict[str, float]:
        """Return the record as plain numbers (for JSON and file attributes)."""
        return asdict(self)


def _duration(seconds: float, of: str) -> str:
    """Return a time in the unit that suits it, or nothing of none."""
    if not seconds:
        return ""
    size, unit = next(
        ((size, unit) for size, unit in ((3600.0, "h"), (60.0, "min")) if seconds >= 2.0 * size),
        (1.0, "s"),
    )
    return f"{seconds / size:.3g} {unit}{of}"


def stopwatch(already: float = 0.0) -> Callable[[], float]:
    """Start a watch: what is returned gives the seconds since, each time it is called.

    Args:
        already: seconds that count as gone.
    """
    start = time.perf_counter() - already
    return lambda: time.perf_counter() - start
