"""Images of simulated ventricles, and tracks of them beside what they show."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from drawn_labels import Drawn
from judged_tracks import CONTOURS, Judged, beside_contours
from seen_surfaces import Truth, in_turn

from modalmotion.errors import InputError
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence, Volume
from modalmotion.simulate import Phantom, PhantomSettings, simulate_images
from modalmotion.simulate.anatomy import Anatomy
from modalmotion.tracking import Track, track
from modalmotion.tracking.label_maps import Labelled, from_labels
from modalmotion.tracking.reading import read_observed


def phantoms(kind: str, seed: int, n: int, n_frames: int, **settings: Any) -> Iterator[Phantom]:
    """Take images of ventricles whose classes take turns; settings as of `PhantomSettings`."""
    for parameters, rng in in_turn(seed, 3000, n):
        set_to = PhantomSettings(**settings)
        yield simulate_images(kind, parameters, n_frames=n_frames, settings=set_to, rng=rng)


def labelled(phantom: Phantom, voxel: float) -> Labelled:
    """Segment the phantom's own surface in voxels of so many mm, and propose its ends."""
    anatomy = Anatomy(phantom.truth, np.random.default_rng(0))
    x = phantom.truth.vertices.astype(np.float64)
    low = x.min(axis=(0, 1)) - 8.0
    shape = np.ceil((x.max(axis=(0, 1)) + 8.0 - low) / voxel).astype(int)
    points = low + voxel * np.moveaxis(np.indices(shape), 0, -1).reshape(-1, 3)
    affine = np.column_stack([voxel * np.eye(3), low])
    frames = []
    for k in range(phantom.truth.n_frames):
        inside = anatomy.lattice.at(anatomy.at(k).cavity[:, None], points)[:, 0] < 0
        frames.append(Volume(3.0 * inside.reshape(shape), affine))
    return from_labels(ImageSequence(tuple(frames), phantom.images.times), (3,))


def tracked(phantom: Phantom, known: Sequence[int] | None = None) -> Track:
    """Track with the apex of the first frame, and the valve of all or of those that are named."""
    base = phantom.landmarks["base"].copy()
    if known is not None:
        base[np.setdiff1d(np.arange(len(base)), known)] = np.nan
    return track(phantom.images, landmarks={"apex": phantom.landmarks["apex"][0], "base": base})


def valve_figures(cases: Iterable[Phantom], *, at_systole: bool) -> tuple[float, float]:
    """Track with the valve at end diastole, and maybe at end systole, known alone.

    The median of each case's largest error of a volume over its 95 %; the share of ejection
    fractions within their intervals.
    """
    ratios, inside = [], []
    for one in cases:
        truth = Truth.of(one.truth)
        result = tracked(one, [0, int(truth.volumes.argmin())] if at_systole else [0])
        assert result.volumes is not None
        assert result.volume_deviations is not None
        off = np.abs(result.volumes - truth.volumes) / (1.96 * result.volume_deviations)
        ratios.append(float(off.max()))
        inside.append(Judged.of(result, truth).is_inside)
    return float(np.median(ratios)), float(np.mean(inside))


def drawn_figures(cases: Iterable[Drawn], labels: tuple[int, ...]) -> tuple[float, ...]:
    """Median and largest error of EF, share inside, share swapped or refused; labels as named."""
    off, inside, swapped = [], [], []
    for case in cases:
        apex, base = (case.truth.vertices[0][list(end)].mean(axis=0) for end in case.truth.ends)
        try:
            made = from_labels(case.images, labels)
            found = Judged.of(track(made.images, landmarks=made.landmarks), case.truth)
        except InputError:
            inside.append(False)
            swapped.append(True)
            continue
        tip = made.landmarks["apex"].places[0]
        swapped.append(bool(np.linalg.norm(tip - apex) > np.linalg.norm(tip - base)))
        off.append(abs(found.off))
        inside.append(found.is_inside)
    return float(np.median(off)), max(off), float(np.mean(inside)), float(np.mean(swapped))


def real_images(_: int) -> tuple[float, float, float]:
    """Track a real heart's cine; see `beside_contours`."""
    recorded = read_observed(CONTOURS)
    # The middle of all valve points: with the outer contours they are no rim of the inner surface.
    base = read_observed(CONTOURS, labels=("LV_",)).landmarks["base"]
    marks = {"apex": recorded.landmarks["apex"][0], "base": base}
    result = track(read_images(CONTOURS.with_name("dicom")), landmarks=marks)
    return beside_contours(result, recorded)
