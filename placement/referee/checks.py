"""What a referee writes down: one check, what was wanted, what was there, how near is near."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, TypeGuard


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was checked; `tolerance` is absolute, None where things must be equal."""

    name: str
    passed: bool
    expected: Any
    got: Any
    tolerance: float | None = None

    def record(self) -> dict[str, Any]:
        """Return the check as `verification.json` holds it."""
        return asdict(self)


def same(name: str, expected: Any, got: Any) -> Check:
    """Check that two things are equal, and of one type: 1 is not true, and "3" is not 3."""
    alike = type(expected) is type(got) or (
        isinstance(expected, int | float)
        and isinstance(got, int | float)
        and not isinstance(expected, bool)
        and not isinstance(got, bool)
    )
    return Check(name, alike and expected == got, expected, got)


def near(name: str, expected: float, got: Any, tolerance: float) -> Check:
    """Check that a number is within `tolerance` of what it should be; NaN never is."""
    good = is_number(got) and abs(float(got) - expected) <= tolerance
    return Check(name, good, expected, got, tolerance)


def none_of(name: str, faults: list[str]) -> Check:
    """Check that there is no fault; the first few are kept."""
    more = [f"and {len(faults) - 5} more"] if len(faults) > 5 else []
    return Check(name, not faults, "no fault", "; ".join(faults[:5] + more) or "no fault")


def is_number(value: Any) -> TypeGuard[float]:
    """Whether JSON gave a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
