"""Pictures of sequences and signatures. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh import lattice_faces
from modalmotion.numerals import numeral
from modalmotion.reconstruction import reconstruct
from modalmotion.sequence import MEAN, MeshSequence, Reference
from modalmotion.signature import ModalSignature, resolve_sequence

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SURFACE = "#c9c4bc"
_REFERENCE = "#7d8791"


def extreme_frame(signature: ModalSignature) -> int:
    """Frame that lies farthest from the reference: end systole for a ventricle."""
    return int(np.argmax(signature.motion_rms))


def systole_figure(sequence: MeshSequence, signature: ModalSignature) -> Figure:
    """Draw the reference, the frame farthest from it, its reconstruction, and the error.

    Parameters
    ----------
    sequence : MeshSequence
    signature : ModalSignature
        Made from that sequence.

    Returns
    -------
    matplotlib.figure.Figure
    """
    frame = extreme_frame(signature)
    reference = sequence.reference_positions(signature.parameters.reference)
    true = sequence.vertices[frame].astype(np.float64)
    superposed = reconstruct(signature, sequence, [frame])[0]
    error = np.linalg.norm(superposed - true, axis=1)
    unit, motion = signature.unit or "length units", float(signature.motion_rms[frame])
    n_amplitudes = 3 * len(signature.modes)
    panels = [
        (reference, None, _named(signature.parameters.reference)),
        (true, None, f"Frame {frame}, moved {numeral(motion, 2)} {unit} RMS"),
        (superposed, None, f"From {n_amplitudes} amplitudes"),
        (
            true,
            error,
            (
                f"Error {numeral(float(signature.rms_errors[frame]), 2, of=motion)} {unit} RMS, "
                f"max {numeral(float(signature.max_errors[frame]), 2, of=motion)}"
            ),
        ),
    ]
    figure = _figure((14.0, 4.6))
    view = _view(reference)
    box = np.concatenate([reference, true]) @ view
    faces = _faces(sequence, signature)
    axes: list[Any] = []
    for column, (vertices, values, title) in enumerate(panels):
        axis = figure.add_subplot(1, 4, column + 1, projection="3d")
        drawn = _draw(axis, vertices @ view, faces, values, box)
        axis.set_title(title, fontsize=10)
        axes.append(axis)
        if values is not None:
            figure.colorbar(
                drawn, ax=axis, shrink=0.6, pad=0.02, label=f"distance to true vertex ({unit})"
            )
    figure.suptitle(
        f"{signature.surface}: {signature.n_vertices} vertices, "
        f"{len(signature.modes)} modes, {signature.compression:.0f}:1 a frame",
        fontsize=11,
    )
    return figure


def mode_count_figure(sequence: MeshSequence, signatures: list[ModalSignature]) -> Figure:
    """Draw one frame reconstructed from more and more modes: figure 1 of Nastar 1994.

    Parameters
    ----------
    sequence : MeshSequence
    signatures : list of ModalSignature
        Of that sequence, with different numbers of modes.

    Returns
    -------
    matplotlib.figure.Figure
    """
    frame = extreme_frame(signatures[0])
    true = sequence.vertices[frame].astype(np.float64)
    unit = signatures[0].unit or "length units"
    superposed = [reconstruct(signature, sequence, [frame])[0] for signature in signatures]
    view = _view(sequence.vertices[0].astype(np.float64))
    box = np.concatenate([true, *superposed]) @ view
    faces = _faces(sequence, signatures[0])
    panels = [(true, f"Frame {frame}: {3 * signatures[0].n_vertices} coordinates\n")]
    panels += [
        (
            vertices,
            (
                f"{3 * len(signature.modes)} amplitudes, {signature.compression:.0f}:1\n"
                f"{numeral(float(signature.rms_errors[frame]), 2)} {unit} RMS"
            ),
        )
        for vertices, signature in zip(superposed, signatures, strict=True)
    ]
    figure = _figure((3.6 * len(panels), 4.4))
    for column, (vertices, title) in enumerate(panels):
        axis = figure.add_subplot(1, len(panels), column + 1, projection="3d")
        _draw(axis, vertices @ view, faces, None, box)
        axis.set_title(title, fontsize=10)
    return figure


def _figure(size: tuple[float, float]) -> Figure:
    # Imported here: only pictures need it. A bare Figure has no window and no global state.
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=120, layout="constrained")


def _faces(sequence: MeshSequence, signature: ModalSignature) -> NDArray[np.int64]:
    if len(sequence.faces):
        return sequence.faces
    resolved = resolve_sequence(sequence, signature.parameters)
    grid, topology = resolved.grid, signature.topology
    if topology is not None and grid is not None and len(grid) == 2 and min(grid) > 1:
        return lattice_faces(topology, grid)
    return sequence.faces


def _view(reference: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation that lays the longest axis upright, the next one across.

    The wider end is above, as ventricles are shown: the apex points down, whatever the file's axes.
    """
    offsets = reference - reference.mean(axis=0)
    _, _, rows = np.linalg.svd(offsets, full_matrices=False)
    height = offsets @ rows[0]
    widths = np.square(offsets).sum(axis=1) - np.square(height)
    if float(height @ (widths - widths.mean())) < 0.0:
        rows = -rows
    view = np.stack([rows[1], rows[2], rows[0]], axis=1)
    if np.linalg.det(view) < 0:
        view[:, 1] *= -1
    return view


def _draw(
    axis: Any,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    values: NDArray[np.float64] | None,
    box: NDArray[np.float64],
) -> Any:
    from matplotlib.colors import LightSource
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    low, high = box.min(axis=0), box.max(axis=0)
    reach = max(float((high - low).max()) / 2, 1e-12)
    middle = (low + high) / 2
    axis.set(
        xlim=(middle[0] - reach, middle[0] + reach),
        ylim=(middle[1] - reach, middle[1] + reach),
        zlim=(middle[2] - reach, middle[2] + reach),
    )
    axis.set_box_aspect((1, 1, 1), zoom=1.5)
    axis.view_init(elev=12, azim=-70)
    axis.set_axis_off()
    if not len(faces):
        segments = np.stack([vertices[:-1], vertices[1:]], axis=1)
        drawn = Line3DCollection(segments, colors=_REFERENCE, linewidths=1.5)
        if values is not None:
            drawn.set(colors=None, cmap="viridis")
            drawn.set_array((values[:-1] + values[1:]) / 2)
    elif values is None:
        drawn = Poly3DCollection(
            vertices[faces],
            facecolors=_SURFACE,
            edgecolors=(0, 0, 0, 0.12),
            linewidths=0.2,
            shade=True,
            lightsource=LightSource(azdeg=300, altdeg=40),
        )
    else:
        drawn = Poly3DCollection(
            vertices[faces], cmap="viridis", edgecolors=(0, 0, 0, 0.08), linewidths=0.2
        )
        drawn.set_array(values[faces].mean(axis=1))
        drawn.set_clim(0.0, max(float(values.max()), 1e-12))
    axis.add_collection3d(drawn)
    return drawn


def _named(reference: Reference) -> str:
    return "Mean shape" if reference == MEAN else f"Reference (frame {reference})"
