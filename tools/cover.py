"""Cover of the 95 % intervals of ejection fraction, strain and dyssynchrony, by kind of recording.

`PYTHONPATH=benchmarks python tools/cover.py` draws 500 simulated ventricles, 100 for each kind, and
prints how many intervals contain the truth, how far the figures are off, and how many intervals of
strain are wider than 6 points.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import Final

import numpy as np
from drawn_contours import contoured
from judged_images import labelled, phantoms, tracked
from read_hearts import noisy, true_dyssynchrony, true_strain, volumes_of
from seen_surfaces import Cases, Truth, in_turn, seen_clouds

import modalmotion as mm
from modalmotion.simulate import Acquisition, simulate_ventricle
from modalmotion.tracking import track

Found = tuple[dict[str, float], mm.MeshSequence | mm.Track]

KINDS: Final = ("meshes", "clouds", "contours", "maps", "images")
FIGURES: Final = ("EF", "GLS", "GCS", "GAS", "SDI")
WIDEST: Final = 6.0  # points, of GLS and GCS
N_FRAMES: Final = 12
N_TRUE: Final = 200


def drawn(kind: str, seed: int, n: int) -> Iterator[Found]:
    """Draw ventricles of all classes: what is true of each, and what is found of it."""
    if kind in ("maps", "images"):
        kinds = {"ct": 1.5} if kind == "maps" else {"ct": 1.5, "mri": 1.0, "cine": 1.0}
        each = [
            phantoms(one, seed + k, -(-n // len(kinds)), 3, coarseness=coarseness)
            for k, (one, coarseness) in enumerate(kinds.items())
        ]
        for k in range(n):
            one = next(each[k % len(each)])
            made = labelled(one, 1.5) if kind == "maps" else None
            found = track(made.images, landmarks=made.landmarks) if made else tracked(one)
            yield true_of(one.truth), found
        return
    cases = list(beats(seed, n))
    if kind == "meshes":
        for _, still, true, rng in cases:
            yield true, noisy(still, 1.0, rng)
        return
    known: Cases = [(truth, rng) for truth, _, _, rng in cases]
    is_cloud = kind == "clouds"
    seen = seen_clouds(known, 1.0) if is_cloud else contoured(seed, n, N_FRAMES, of=known)
    for (truth, frames), (_, _, true, _) in zip(seen, cases, strict=True):
        if is_cloud:
            yield true, track(frames, start=truth.start(), unit="mm")
        else:
            leaning = mm.mesh_sequence(truth.vertices, truth.faces, grid=truth.grid, topology="cup")
            strains = {**true_of(leaning), "SDI": true["SDI"]}
            yield strains, track(frames, topology="cup", unit="mm")


def beats(
    seed: int, n: int
) -> Iterator[tuple[Truth, mm.MeshSequence, dict[str, float], np.random.Generator]]:
    """Simulate beats, and each once more in so many frames that they do not matter."""
    for k, (parameters, rng) in enumerate(in_turn(seed, 5000, n)):
        few, many = (
            simulate_ventricle(
                parameters,
                grid=(24, 48),
                acquisition=Acquisition(n_frames=frames),
                rng=np.random.default_rng([seed, k]),
            )
            for frames in (N_FRAMES, N_TRUE)
        )
        yield Truth.of(few), few, {**true_of(few), "SDI": true_dyssynchrony(many)}, rng


def true_of(clean: mm.MeshSequence) -> dict[str, float]:
    """Ejection fraction and strain of a surface without errors."""
    volumes = volumes_of(clean)
    strain = {name.upper(): value for name, value in true_strain(clean).items()}
    return {"EF": float(100.0 * (1.0 - volumes.min() / volumes.max())), **strain}


def stated(found: mm.MeshSequence | mm.Track) -> dict[str, tuple[float, float, float]]:
    """Each figure with the ends of its interval."""
    strain = mm.strain(found)
    sequence = found.sequence if isinstance(found, mm.Track) else found
    curve = mm.clinical_readouts(mm.modal_signature(sequence), sequence).curve
    of_all: dict[str, tuple[float, float, float]] = {**strain.end_systolic}
    if curve.share is not None and curve.share_range is not None:
        of_all["EF"] = (curve.share, *curve.share_range)
    if strain.dyssynchrony is not None:
        of_all["SDI"] = strain.dyssynchrony
    return of_all


def row(kind: str, seed: int, n: int) -> str:
    """One line for each figure of a kind."""
    errors: dict[str, list[tuple[float, bool, float]]] = {name: [] for name in FIGURES}
    for true, found in drawn(kind, seed, n):
        of = stated(found)
        for name in FIGURES:
            if name in of and name in true:
                value, low, high = of[name]
                inside = low <= true[name] <= high
                errors[name].append((abs(value - true[name]), inside, high - low))
    lines = []
    for name, each in errors.items():
        if each:
            off, held, width = np.array(each, dtype=np.float64).T
            cover, error, mean = 100.0 * held.mean(), off.mean(), width.mean()
            text = f"{kind:9} {name:4} {len(each):4} {cover:6.1f} % {error:6.2f} {mean:6.2f}"
            if name in ("GLS", "GCS"):
                text += f" {100.0 * float((width > WIDEST).mean()):6.1f} %"
            lines.append(text)
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=500, help="of all kinds together")
    parser.add_argument("--only", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    sys.stdout.write("kind      figure  n   cover   |error|  width   wider than 6\n")
    for kind in options.only:
        sys.stdout.write(row(kind, options.seed, options.draws // len(KINDS)) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
