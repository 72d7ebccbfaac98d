"""Motion from images: phantoms whose surface is known, capture, stated deviations, one real heart.

Seeds are not those of 101 to 105, on which the constants were set.
"""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from image_peers import labelled, peers
from measure import Table
from numpy.typing import NDArray
from real_data import DATA, is_there, recording

from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.simulate import MotionClass, Phantom, PhantomSettings, draw_parameters
from modalmotion.simulate import simulate_images as taken
from modalmotion.tracking import Track, track
from modalmotion.tracking.closest import closest_points
from modalmotion.tracking.reading import read_observed

N_CASES, N_FRAMES, N_STATED_FRAMES = 4, 10, 3
N_STATED = int(os.environ.get("STATED", "20"))
N_PEER_FRAMES = 3
Floats = NDArray[np.float64]

# Of the base's height: beyond it landmarks place the surface, and not the images.
_INNER = 0.97


class Kind(NamedTuple):
    """A row: kind of image, settings, and bounds of the surface, mm, and of EF, points."""

    name: str
    kind: str
    settings: PhantomSettings
    surface: float
    fraction: float


KINDS = (
    Kind("CT 1 mm", "ct", PhantomSettings(), 0.7, 3.0),
    Kind("echo 1.2 mm", "echo", PhantomSettings(), 0.8, 2.0),
    Kind("MRI 1.4 x 1.4 x 8", "mri", PhantomSettings(), 1.3, 3.0),
    Kind("MRI, slices 2 mm aside", "mri", PhantomSettings(slice_shift=2.0), 1.5, 3.0),
    Kind("cine, 9 planes", "cine", PhantomSettings(), 1.3, 3.0),
)


def run(_folder: Path) -> list[Table]:
    """Measure everything."""
    tables = [beside_others(), phantoms(N_CASES), capture(), stated(N_STATED)]
    needed = "cine/dicom", "cine/contours", "heart/lv_endocardium"
    return [*tables, real()] if is_there("images: real cine MRI", *needed) else tables


def case(kind: Kind, seed: int, n_frames: int = N_FRAMES) -> Phantom:
    """Take images of one ventricle; classes take turns."""
    rng = np.random.default_rng(seed)
    classes = list(MotionClass)
    parameters = draw_parameters(classes[seed % len(classes)], rng)
    return taken(kind.kind, parameters, n_frames=n_frames, settings=kind.settings, rng=rng)


@dataclass(frozen=True, eq=False)
class Result:
    """A track beside the truth."""

    track: Track
    distances: Floats
    fraction: float
    true_fraction: float
    ratios: Floats
    seconds: float


def followed(phantom: Phantom, images: ImageSequence | None = None, **options: Any) -> Result:
    """Track with the apex in the reference frame and the valve in each."""
    marks = {"apex": phantom.landmarks["apex"][0], "base": phantom.landmarks["base"]}
    marks |= options.pop("landmarks", {})
    start = time.process_time()
    result = track(phantom.images if images is None else images, landmarks=marks, **options)
    seconds = (time.process_time() - start) / result.n_frames
    x = phantom.truth.vertices.astype(np.float64)
    inner = result.template.coordinates[:, 0] < _INNER
    distances, ratios = [], []
    for k, own in enumerate(result.sequence.vertices.astype(np.float64)):
        distances.append(closest_points(x[k], own, result.template.faces).distances.mean())
        off = closest_points(own[inner], x[k], phantom.truth.faces).distances
        ratios.append(off / result.deviations[k, inner, 0])
    volumes = np.abs(cavity_of(phantom.truth.faces, x.shape[1]).volume(x))
    true = 100.0 * (1.0 - volumes.min() / volumes.max())
    fraction = result.ejection_fraction or 0.0
    return Result(
        result, np.array(distances), fraction, float(true), np.concatenate(ratios), seconds
    )


def phantoms(n: int) -> Table:
    """Cold starts, the valve known in each frame, or at end diastole and end systole."""
    table = Table(f"{n} ventricles of each kind, {N_FRAMES} frames", ("images", "figure", "value"))
    for kind in KINDS:
        cases = [case(kind, 1000 + seed) for seed in range(n)]
        results = [followed(phantom) for phantom in cases]
        surface = float(np.mean([r.distances.mean() for r in results]))
        off = np.array([r.fraction - r.true_fraction for r in results])
        seconds = float(np.mean([r.seconds for r in results]))
        table.add_at_most(surface, kind.surface, kind.name, "surface mean, mm", f"{surface:.2f}")
        worst = float(np.abs(off).max())
        table.add_at_most(worst, kind.fraction, kind.name, "EF off, worst, points", f"{worst:.1f}")
        table.add(kind.name, "EF off, mean, points", f"{off.mean():+.1f}")
        table.add_at_most(seconds, 0.6, kind.name, "s a frame", f"{seconds:.2f}")
        if kind.name.endswith("8"):
            _two_valves(table, kind, cases)
    return table


def beside_others() -> Table:
    """Compare time and error with other tools on one CT."""
    phantom = case(KINDS[0], 1000, N_PEER_FRAMES)
    own = followed(phantom)
    return peers(phantom, (float(own.distances.mean()), own.seconds))


def _two_valves(table: Table, kind: Kind, cases: list[Phantom]) -> None:
    offs, inside = [], 0
    for phantom in cases:
        x = phantom.truth.vertices.astype(np.float64)
        volumes = np.abs(cavity_of(phantom.truth.faces, x.shape[1]).volume(x))
        base = np.full_like(phantom.landmarks["base"], np.nan)
        known = [0, int(volumes.argmin())]
        base[known] = phantom.landmarks["base"][known]
        result = followed(phantom, landmarks={"base": base})
        offs.append(result.fraction - result.true_fraction)
        inside += abs(offs[-1]) <= (result.track.ejection_fraction_bound or 0.0)
    worst = float(np.abs(offs).max())
    table.add_at_most(worst, 3.0, kind.name, "EF off, valve known twice", f"{worst:.1f}")
    table.add(kind.name, "of these inside its interval", f"{inside} of {len(cases)}")


def capture() -> Table:
    """Compare surfaces from starts 20 mm off, of other radii, and in inverted images."""
    table = Table(
        "Starts far off and inverted contrast, one frame", ("images", "start", "mm apart")
    )
    for kind, bound in ((KINDS[0], 0.2), (KINDS[1], 0.2), (KINDS[2], 0.5)):
        phantom = case(kind, 1001, 1)
        marks = {name: place[0] for name, place in phantom.landmarks.items()}
        here = track(phantom.images, landmarks=marks)
        x = here.sequence.vertices[0].astype(np.float64)
        middle = (marks["apex"] + marks["base"]) / 2
        axis = (marks["base"] - marks["apex"]) / np.linalg.norm(marks["base"] - marks["apex"])
        aside = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        aside *= 20.0 / np.linalg.norm(aside)
        for share in (0.3, 1.0, 1.2):
            r = x - middle
            along = np.outer(r @ axis, axis)
            far = middle + along + share * (r - along) + aside
            start = mesh_sequence(far[None], here.template.faces, grid=(32, 64), topology="cup")
            own = track(phantom.images, landmarks=marks, start=start)
            apart = _apart(here, own)
            table.add_at_most(
                apart, bound, kind.name, f"radius {share:g}, 20 mm off", f"{apart:.2f}"
            )
        apart = _apart(here, track(_inverted(phantom.images), landmarks=marks))
        table.add_at_most(apart, bound, kind.name, "inverted", f"{apart:.2f}")
    return table


def _apart(one: Track, other: Track) -> float:
    a, b = (t.sequence.vertices[0].astype(np.float64) for t in (one, other))
    return float(closest_points(a, b, other.template.faces).distances.mean())


def _inverted(images: ImageSequence) -> ImageSequence:
    def turned(frame: Volume | PlaneSet | None) -> Volume | PlaneSet | None:
        if isinstance(frame, Volume):
            return Volume(-frame.values.astype(np.float32), frame.affine)
        if isinstance(frame, PlaneSet):
            return PlaneSet(tuple(Plane(-p.values, p.affine, p.thickness) for p in frame.planes))
        return None

    return ImageSequence(tuple(map(turned, images.frames)), images.times, images.period)


def stated(n: int) -> Table:
    """How often stated deviations and the interval of EF hold; STATED=100 takes an hour."""
    table = Table(
        f"Stated deviations, {n} phantoms of each kind, {N_STATED_FRAMES} frames",
        ("images", "figure", "value"),
    )
    for kind in KINDS:
        _stated_row(table, kind.name, [_stated_case(kind, 2000 + k) for k in range(n)])
    _stated_row(table, "label map, 1.5 mm", [_stated_labels(2000 + k) for k in range(n)])
    return table


class Stated(NamedTuple):
    """Of one phantom: vertices within one and 1.96 deviations, whether EF is inside, EF off."""

    one: float
    two: float
    is_inside: bool
    off: float


def _stated_case(kind: Kind, seed: int) -> Stated:
    return _held(followed(case(kind, seed, N_STATED_FRAMES)))


def _stated_labels(seed: int) -> Stated:
    """Track the true surface as a segmentation, its ends proposed from itself."""
    rough = Kind("", "ct", PhantomSettings(coarseness=4.0), 0.0, 0.0)
    phantom = case(rough, seed, N_STATED_FRAMES)
    made = labelled(phantom, 1.5)
    return _held(followed(phantom, made.images, landmarks=made.landmarks))


def _held(result: Result) -> Stated:
    one, two = (float((result.ratios < limit).mean()) for limit in (1.0, 1.96))
    return Stated(one, two, _is_inside(result), result.fraction - result.true_fraction)


def _stated_row(table: Table, name: str, rows: list[Stated]) -> None:
    # Each phantom has as many vertices.
    one, two, inside, off = np.array(rows, dtype=np.float64).T
    table.add_at_least(one.mean(), 0.55, name, "68 % covers", f"{one.mean():.1%}")
    table.add_at_most(one.mean(), 0.80, name, "68 % covers", f"{one.mean():.1%}")
    table.add_at_least(two.mean(), 0.88, name, "95 % covers", f"{two.mean():.1%}")
    table.add_at_least(inside.mean(), 0.90, name, "EF inside its interval", f"{inside.mean():.0%}")
    spread = f"{off.mean():+.1f} +- {off.std():.1f}, {np.abs(off).max():.1f}"
    table.add(name, "EF off, points: mean, deviation, worst", spread)


def _is_inside(result: Result) -> bool:
    bound = result.track.ejection_fraction_bound
    return bound is not None and abs(result.fraction - result.true_fraction) <= bound


def real() -> Table:
    """Track a patient's cine images, against contours and meshes of the same heart."""
    table = Table("Real cine MRI, 9 planes, 25 phases", ("figure", "value"))
    recorded = read_observed(DATA / "cine" / "contours")
    # The middle of all valve points: with the outer contours they are no rim of the inner surface.
    base = read_observed(DATA / "cine" / "contours", contours=("LV_",)).landmarks["base"]
    marks = {"apex": recorded.landmarks["apex"][0], "base": base}
    result = track(read_images(DATA / "cine" / "dicom"), landmarks=marks)
    heart = recording("heart/lv_endocardium")
    true = np.abs(
        cavity_of(heart.faces, heart.n_vertices).volume(heart.vertices.astype(np.float64))
    )
    distances = [
        closest_points(frame[0].points, x.astype(np.float64), result.template.faces).distances
        for frame, x in zip(recorded.frames, result.sequence.vertices, strict=True)
    ]
    off = float(np.mean([d.mean() for d in distances]))
    table.add_at_most(off, 2.0, "to the contours, mm", f"{off:.2f}")
    table.add_at_most(len(result.unseen), 0, "phases lost", str(len(result.unseen)))
    volumes = np.zeros(len(true)) if result.volumes is None else result.volumes
    r = float(np.corrcoef(volumes, true)[0, 1])
    table.add_at_least(r, 0.98, "r of volumes", f"{r:.3f}")
    # Frame 0 is where its contours have end diastole.
    reference = float(100.0 * (1.0 - true.min() / true[0]))
    for name, value in result.ejection_fractions.items():
        if name == "pool":
            gap = abs(value - reference)
            table.add_at_most(gap, 6.0, f"EF, {name}", f"{value:.1f} (mesh {reference:.1f})")
        else:
            table.add(f"EF, {name}", f"{value:.1f}")
    return table
