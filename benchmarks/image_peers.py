"""Tools that others use on images, beside tracking, in one run: time and error on one phantom."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
from judged_images import tracked
from judged_tracks import Judged
from measure import Table
from numpy.typing import NDArray
from phantoms import phantoms
from seen_surfaces import Truth

from modalmotion.images import Volume
from modalmotion.simulate import Phantom
from modalmotion.tracking.closest import closest_points

Floats: TypeAlias = NDArray[np.float64]
Peer = Callable[[Phantom], tuple[float, float]]

# mm of image around the ventricle that peers are given.
_MARGIN: Final = 15.0
_N_STEPS: Final = 100
_N_SPLINE_STEPS: Final = 20


def run(_folder: Path) -> list[Table]:
    """Measure everything."""
    phantom = next(phantoms("ct", 1000, 1, 3))
    return [peers(phantom)]


def peers(phantom: Phantom) -> Table:
    """Time and error of each tool."""
    start = time.process_time()
    result = tracked(phantom)
    seconds = (time.process_time() - start) / result.n_frames
    off = Judged.of(result, Truth.of(phantom.truth)).distance
    table = Table(
        f"{phantom.images.n_frames} frames of a simulated CT, 1 mm",
        ("tool", "surface mean, mm", "s a frame", "times ours"),
    )
    table.add("tracking in modes", f"{off:.2f}", f"{seconds:.2f}", "1")
    tools: tuple[tuple[str, str, Peer, float | None], ...] = (
        ("Chan-Vese, scikit-image", "skimage.segmentation", _chan_vese, 30.0),
        ("demons, SimpleITK, true first surface", "SimpleITK", _demons, None),
        ("B-splines, SimpleITK, true first surface", "SimpleITK", _splines, None),
    )
    for name, package, call, bound in tools:
        try:
            importlib.import_module(package)
        except ModuleNotFoundError:
            table.add(name, "not installed", "", "")
            continue
        their_off, their_seconds = call(phantom)
        times = their_seconds / seconds
        cells = (name, f"{their_off:.2f}", f"{their_seconds:.1f}", f"{times:.0f}")
        if bound is None:
            table.add(*cells)
        else:
            table.add_at_least(times, bound, *cells)
    return table


def _cropped(phantom: Phantom) -> tuple[list[Floats], Floats, float]:
    """Cut out samples of all frames around the ventricle, their place, and the side of a voxel."""
    x = phantom.truth.vertices.astype(np.float64)
    volumes = [one for one in phantom.images.frames if isinstance(one, Volume)]
    affine = volumes[0].affine
    step = float(affine[0, 0])
    origin = affine[:3, 3]
    first = np.maximum(((x.min(axis=(0, 1)) - _MARGIN - origin) / step).astype(int), 0)
    last = ((x.max(axis=(0, 1)) + _MARGIN - origin) / step).astype(int)
    box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    return [one.values[box].astype(np.float64) for one in volumes], origin + step * first, step


def _chan_vese(phantom: Phantom) -> tuple[float, float]:
    """Begin from a ball between the landmarks, as it knows no valve."""
    segmentation = importlib.import_module("skimage.segmentation")
    measure = importlib.import_module("skimage.measure")
    frames, origin, step = _cropped(phantom)
    offs, seconds = [], []
    for k, values in enumerate(frames):
        ends = [phantom.landmarks[name][k] for name in ("apex", "base")]
        middle, reach = (ends[0] + ends[1]) / 2, float(np.linalg.norm(ends[1] - ends[0])) / 4
        places = np.moveaxis(np.indices(values.shape), 0, -1) * step + origin
        begin = np.linalg.norm(places - middle, axis=-1) < reach
        start = time.process_time()
        mask = segmentation.morphological_chan_vese(
            values, _N_STEPS, init_level_set=begin.astype(np.int8), smoothing=2
        )
        seconds.append(time.process_time() - start)
        vertices, faces, _, _ = measure.marching_cubes(mask.astype(np.float64), 0.5)
        offs.append(_off(phantom, k, vertices * step + origin, faces))
    return float(np.mean(offs)), float(np.mean(seconds))


def _off(phantom: Phantom, frame: int, vertices: Floats, faces: Any) -> float:
    true = phantom.truth.vertices[frame].astype(np.float64)
    return float(closest_points(true, vertices, np.asarray(faces, np.int64)).distances.mean())


def _demons(phantom: Phantom) -> tuple[float, float]:
    sitk: Any = importlib.import_module("SimpleITK")
    method = sitk.FastSymmetricForcesDemonsRegistrationFilter()
    method.SetNumberOfIterations(_N_STEPS)
    method.SetStandardDeviations(1.5)

    def registered(fixed: Any, moving: Any) -> Any:
        field = method.Execute(fixed, moving)
        return sitk.DisplacementFieldTransform(sitk.Cast(field, sitk.sitkVectorFloat64))

    return _propagated(phantom, registered)


def _splines(phantom: Phantom) -> tuple[float, float]:
    sitk: Any = importlib.import_module("SimpleITK")

    def registered(fixed: Any, moving: Any) -> Any:
        method = sitk.ImageRegistrationMethod()
        method.SetMetricAsMeanSquares()
        method.SetInterpolator(sitk.sitkLinear)
        method.SetOptimizerAsLBFGSB(numberOfIterations=_N_SPLINE_STEPS)
        begin = sitk.BSplineTransformInitializer(fixed, [6, 6, 6])
        method.SetInitialTransform(begin, inPlace=True)
        method.SetShrinkFactorsPerLevel([4])
        method.SetSmoothingSigmasPerLevel([2])
        return method.Execute(fixed, moving)

    return _propagated(phantom, registered)


def _propagated(phantom: Phantom, register: Callable[[Any, Any], Any]) -> tuple[float, float]:
    """Carry the true first surface to every other frame by a registration of the images."""
    sitk: Any = importlib.import_module("SimpleITK")
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(1)
    frames, origin, step = _cropped(phantom)
    images = []
    for values in frames:
        image = sitk.GetImageFromArray(values.transpose(2, 1, 0).astype(np.float32))
        image.SetOrigin(origin.tolist())
        image.SetSpacing([step] * 3)
        images.append(image)
    first = phantom.truth.vertices[0].astype(np.float64)
    offs, seconds = [0.0], []
    for k, image in enumerate(images[1:], start=1):
        start = time.process_time()
        moved = register(images[0], image)
        seconds.append(time.process_time() - start)
        own = np.array([moved.TransformPoint(place) for place in first.tolist()])
        offs.append(_off(phantom, k, own, phantom.truth.faces))
    return float(np.mean(offs)), float(np.mean(seconds))
