"""Rows of the table of truth: bits, kept promises and time of the codec."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from coded_sequences import SEQUENCES, SHARE, TARGETS, beat, coded, mean_diagonal
from experiments import Row, experiment, timed
from measure import beside_numpy

from modalmotion.codec import Effort, decode, encode

for _name, (_what, _path, _) in SEQUENCES.items():
    experiment(
        *(
            Row(f"codec.{_name}.{target}.{effort}", f"{_what}: {target} 0.3 %, {effort}", "bits")
            for target in TARGETS
            for effort in Effort
        ),
        Row(f"codec.{_name}.kept", f"{_what}: largest error over the one promised", goal=1),
        Row(f"codec.{_name}.disorder", f"{_what}: effort pairs whose higher has more bits", goal=0),
        quick=_name == "lattice",
        needs=(_path,) if _path else (),
    )(partial(coded, _name))


@timed(
    *(
        Row(f"codec.{what}.{effort}", f"{what} 15 frames, {effort}, over NumPy's fixed work")
        for effort in Effort
        for what in ("encode", "decode")
    ),
)
def times(_: int) -> tuple[float, ...]:
    surface, calls = beat(1000, 15), dict[str, Callable[[], object]]()
    for effort in Effort:
        encoded = partial(encode, surface, rms=SHARE * mean_diagonal(surface), effort=effort)
        calls |= {f"encode {effort}": encoded, f"decode {effort}": partial(decode, encoded().data)}
    found = beside_numpy(calls, n_samples=3)
    return tuple(found.values())
