"""Images of simulated ventricles, and label maps of their own surfaces."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from seen_surfaces import in_turn

from modalmotion.images import ImageSequence, Volume
from modalmotion.simulate import Phantom, PhantomSettings, simulate_images
from modalmotion.simulate.anatomy import Anatomy
from modalmotion.tracking.label_maps import Labelled, from_labels


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
