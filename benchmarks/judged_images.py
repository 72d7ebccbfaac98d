"""Tracks of images beside what they show: where the valve is stated, and of hand-drawn maps."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from drawn_labels import Drawn
from judged_tracks import Judged
from seen_surfaces import Truth

from modalmotion.errors import InputError
from modalmotion.simulate import Phantom
from modalmotion.tracking import Track, track
from modalmotion.tracking.label_maps import from_labels


def tracked(phantom: Phantom, known: Sequence[int] | None = None) -> Track:
    """Track with the apex of the first frame, and the valve of all or of those that are named."""
    base = phantom.landmarks["base"].copy()
    if known is not None:
        base[np.setdiff1d(np.arange(len(base)), known)] = np.nan
    return track(phantom.images, landmarks={"apex": phantom.landmarks["apex"][0], "base": base})


def valve_figures(phantoms: Iterable[Phantom], *, at_systole: bool) -> tuple[float, float]:
    """Track with the valve at end diastole, and maybe at end systole, known alone.

    The median of each case's largest error of a volume over its 95 %; the share of ejection
    fractions within their intervals.
    """
    ratios, inside = [], []
    for one in phantoms:
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
