"""Tools that others use on images, beside tracking: time and error on one phantom."""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from typing import Any, Final, TypeAlias

import numpy as np
from judged_images import tracked
from judged_tracks import Judged
from measure import table
from numpy.typing import NDArray
from phantoms import phantoms
from seen_surfaces import Truth

from modalmotion.images import Volume
from modalmotion.simulate import Phantom
from modalmotion.tracking.closest import closest_points

Floats: TypeAlias = NDArray[np.float64]
_MARGIN: Final = 15.0  # mm of image around the ventricle that peers are given
_N_STEPS: Final = 100


def run() -> list[str]:
    """Time and error of each tool."""
    phantom = next(phantoms("ct", 1000, 1, 3))
    start = time.process_time()
    result = tracked(phantom)
    seconds = (time.process_time() - start) / result.n_frames
    off = Judged.of(result, Truth.of(phantom.truth)).distance
    rows = [("tracking in modes", f"{off:.2f}", f"{seconds:.2f}", "1")]
    demons = "demons, SimpleITK, true first surface"
    for name, call in {"Chan-Vese, scikit-image": _chan_vese, demons: _demons}.items():
        try:
            theirs, took = call(phantom)
        except ModuleNotFoundError as missing:
            rows.append((name, f"{missing.name} is not installed", "", ""))
        else:
            rows.append((name, f"{theirs:.2f}", f"{took:.1f}", f"{took / seconds:.0f}"))
    title = f"{phantom.images.n_frames} frames of a simulated CT, 1 mm"
    return [table(title, ["tool", "surface mean, mm", "s a frame", "times ours"], rows)]


def _cropped(phantom: Phantom) -> tuple[list[Floats], Floats, float]:
    """Cut out samples of all frames around the ventricle, their place, and the side of a voxel."""
    x = phantom.truth.vertices.astype(np.float64)
    volumes = [one for one in phantom.images.frames if isinstance(one, Volume)]
    step, origin = float(volumes[0].affine[0, 0]), volumes[0].affine[:3, 3]
    first = np.maximum(((x.min(axis=(0, 1)) - _MARGIN - origin) / step).astype(int), 0)
    last = ((x.max(axis=(0, 1)) + _MARGIN - origin) / step).astype(int)
    box = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    return [one.values[box].astype(np.float64) for one in volumes], origin + step * first, step


def _chan_vese(phantom: Phantom) -> tuple[float, float]:
    """Begin from a ball between the landmarks, as it knows no valve."""
    segment = import_module("skimage.segmentation").morphological_chan_vese
    marching = import_module("skimage.measure").marching_cubes
    frames, origin, step = _cropped(phantom)
    offs, start = [], time.process_time()
    for k, values in enumerate(frames):
        apex, base = (phantom.landmarks[name][k] for name in ("apex", "base"))
        places = np.moveaxis(np.indices(values.shape), 0, -1) * step + origin
        inside = np.linalg.norm(places - (apex + base) / 2, axis=-1)
        begin = (inside < np.linalg.norm(base - apex) / 4).astype(np.int8)
        mask = segment(values, _N_STEPS, init_level_set=begin, smoothing=2)
        vertices, faces, _, _ = marching(mask.astype(np.float64), 0.5)
        offs.append(_off(phantom, k, vertices * step + origin, faces))
    return float(np.mean(offs)), (time.process_time() - start) / len(frames)


def _demons(phantom: Phantom) -> tuple[float, float]:
    """Carry the true first surface to every other frame by registrations of the images."""
    sitk: Any = import_module("SimpleITK")
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(1)
    method = sitk.FastSymmetricForcesDemonsRegistrationFilter()
    method.SetNumberOfIterations(_N_STEPS)
    method.SetStandardDeviations(1.5)
    frames, origin, step = _cropped(phantom)
    images = []
    for values in frames:
        image = sitk.GetImageFromArray(values.transpose(2, 1, 0).astype(np.float32))
        image.SetOrigin(origin.tolist())
        image.SetSpacing([step] * 3)
        images.append(image)
    first = phantom.truth.vertices[0].astype(np.float64).tolist()
    offs, start = [0.0], time.process_time()
    for k, image in enumerate(images[1:], start=1):
        field = sitk.Cast(method.Execute(images[0], image), sitk.sitkVectorFloat64)
        moved: Callable[[Any], Any] = sitk.DisplacementFieldTransform(field).TransformPoint
        offs.append(_off(phantom, k, np.array([*map(moved, first)]), phantom.truth.faces))
    return float(np.mean(offs)), (time.process_time() - start) / len(images[1:])


def _off(phantom: Phantom, frame: int, vertices: Floats, faces: Any) -> float:
    true = phantom.truth.vertices[frame].astype(np.float64)
    return float(closest_points(true, vertices, np.asarray(faces, np.int64)).distances.mean())
