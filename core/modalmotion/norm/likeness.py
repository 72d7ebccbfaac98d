"""In what a recording was not made like the controls."""

from __future__ import annotations

from collections.abc import Sequence

from modalmotion.norm.controls import Reading


def warnings_of(controls: Sequence[Reading], own: Reading) -> tuple[str, ...]:
    """Compare the conditions and covariates of a recording with those of controls.

    A number is unlike theirs where it lies farther beyond them than they lie apart, so that a
    recording like them is hardly ever warned of.
    """
    warnings = []
    for what in ("conditions", "covariates"):
        mine, theirs = getattr(own, what), [getattr(one, what) for one in controls]
        for name, value in mine.items():
            known = [one[name] for one in theirs if name in one]
            said = _unlike(name, value, known, is_condition=what == "conditions")
            if said:
                warnings.append(said)
    trackings = {one.tracking for one in controls}
    if own.tracking not in trackings:
        warnings.append(
            f"tracking: {own.tracking}; of the controls {', '.join(sorted(trackings))}."
        )
    return tuple(warnings)


def _unlike(
    name: str, value: float | str, known: Sequence[float | str], *, is_condition: bool
) -> str | None:
    if not known:
        return None
    if isinstance(value, str):
        words = sorted({str(one) for one in known})
        if value in words:
            return None
        return f"{_called(name)}: {value}; of the controls {', '.join(words[:5])}."
    numbers = [float(one) for one in known if not isinstance(one, str)]
    if not numbers:
        return None
    low, high = min(numbers), max(numbers)
    # Who is older than all controls is beyond what they can tell.
    margin = (high - low) if is_condition else 0.0
    if low - margin <= value <= high + margin:
        return None
    theirs = f"{low:g}" if low == high else f"{low:g} to {high:g}"
    return f"{_called(name)}: {float(value):g}; of the controls {theirs}."


def _called(name: str) -> str:
    return f"number of {name}" if name in ("frames", "vertices") else name
