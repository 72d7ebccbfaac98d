"""Commands that show vibration modes: their table and pictures, and motions composed of them."""

from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import numpy as np

from modalmotion import errors, formats, notes, store
from modalmotion.cli import shared
from modalmotion.cli.files import read, sequence_argument
from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes import ModeLabel, topologies
from modalmotion.modes.lattice import Lattice
from modalmotion.signature import making
from modalmotion.template import Template, make_template
from modalmotion.template.body_frame import Direction, directions_on
from modalmotion.template.vibration_modes import (
    VibrationModes,
    lattice_modes,
    lattice_modes_named,
    surface_modes,
    surface_modes_named,
)

_GRIDS: Final = {1: (64,), 2: (32, 64), 3: (8, 8, 16)}
_MODE_FILES: Final = (*shared.PICTURES, ".glb", ".npz", ".h5")
_ANIMATIONS: Final = (".glb", ".vtkhdf", ".npz", ".zip", ".gif")
_TERMS: Final = {"flag": "mode", "type": str, "multiple": True, "metavar": "LABEL=AMPLITUDE"}


class _Surface(NamedTuple):
    """Subject of a command: a lattice by its name, the surface in a file, or both."""

    lattice: Lattice | None
    template: Template | None
    unit: str | None


@shared.command("modes cylinder --grid 32,64 --modes 7 -o modes.png")
@sequence_argument
@shared.surface_options
def modes(
    source: Path,
    grid: tuple[int, ...] | None,
    topology: str | None,
    modes: int = 7,
    direction: Direction = Direction.NORMAL,
    output: Annotated[Path | None, shared.OutputFile(*_MODE_FILES)] = None,
    **stated: Any,
) -> Any:
    """List the vibration modes of a lattice or of the surface in FILE.

    FILE may be the name of a topology: curve, plane, cylinder, torus, cup, sphere or the ends of
    each axis; its frequencies are those of a lattice with K = M = 1. Those of a surface in a file
    are w = c k on its own lengths, c one length unit per s.

    Parameters
    ----------
    modes
        How many; no pair is split.
    direction
        Direction in which the vertices move.
    output
        Picture (.png, .svg, .pdf), animation (.glb), or shapes (.npz, .h5) to write.
    """
    surface = _surface(source, grid, topology, stated)
    vibration_modes = _lowest(surface, modes)
    if output is not None:
        _write_modes(output, surface, vibration_modes, direction)
    frequencies = vibration_modes.angular_frequencies.tolist()
    return {
        "surface": vibration_modes.surface,
        "frequency_unit": vibration_modes.frequency_unit,
        "modes": [
            {"label": str(label), "angular_frequency": w}
            for label, w in zip(vibration_modes.labels, frequencies, strict=True)
        ],
        "notes": notes.notes_as_json(vibration_modes.notes),
    }


@shared.command("animate beat.npz --mode 1,1,cos=5 --mode 0,2,sin=3 -o swing.glb")
@sequence_argument
@shared.surface_options
def animate(
    source: Path,
    grid: tuple[int, ...] | None,
    topology: str | None,
    terms: Annotated[tuple[str, ...], _TERMS],
    output: Annotated[Path, shared.OutputFile(*_ANIMATIONS)],
    direction: Direction = Direction.NORMAL,
    frames: int = 48,
    seconds: float = 2.0,
    damping: float = 0.0,
    together: bool = False,
    **stated: Any,
) -> Any:
    """Animate vibration modes of the surface in FILE.

    Frame 0 is the surface displaced by all modes; then it is released, and each mode oscillates as
    a cosine at its own frequency, with time scaled so that the slowest takes --seconds. Mode 0 does
    not oscillate. FILE may be the name of a topology, as for `modalmotion modes`; its radius is 1.

    Parameters
    ----------
    terms
        Such as 1,1,cos=5, in the unit of FILE; 'spring 3=5' on a mesh. Repeat for more.
    output
        .glb, .vtkhdf, .npz, .zip (of PLY) or .gif.
    direction
        Direction in which the vertices move.
    frames
        Frames over one period of the slowest mode.
    seconds
        Duration of this period.
    damping
        Share of each mode's critical damping.
    together
        All modes oscillate with the same period.
    """
    from modalmotion.exports.animation import swing

    labels, amplitudes = _terms(terms)
    surface = _surface(source, grid, topology, stated)
    if surface.lattice is not None:
        vibration_modes = lattice_modes_named(surface.lattice, labels)
    else:
        vibration_modes = surface_modes_named(_template(surface), labels)
    template = _template(surface)
    motion = swing(
        template,
        vibration_modes,
        np.array(amplitudes),
        directions_on(template, direction),
        n_frames=frames,
        seconds=seconds,
        damping=damping,
        together=together,
        unit=surface.unit,
    )
    _write_animation(output, template, motion, seconds / frames)
    names = list(map(str, labels))
    return {"n_frames": frames, "modes": names, "n_vertices": template.n_vertices}


def _surface(
    source: Path, grid: tuple[int, ...] | None, topology: str | None, stated: dict[str, Any]
) -> _Surface:
    """Read the file, or make the lattice named instead."""
    if not source.exists():
        try:
            named = topologies.Topology.parse(str(source))
        except errors.TopologyError:
            named = None
        if named is not None:
            lattice = Lattice(named, _GRIDS[named.n_axes] if grid is None else grid)
            if named.n_axes == 3:
                return _Surface(lattice, None, None)
            return _Surface(lattice, make_template(standard_surface(lattice)), None)
    # It states how the surface is treated, not its topology.
    kind = topology if topology == topologies.MESH else None
    sequence = read(source, grid=grid, topology=None if kind else topology, **stated)
    parameters = making.resolve_parameters(sequence, making.SignatureParameters(topology=kind))
    return _Surface(None, making.resolve_template(sequence, parameters), sequence.unit)


def _template(surface: _Surface) -> Template:
    if surface.template is None:
        raise errors.TopologyError(
            "A volume has no surface to draw or to move.",
            remedy="Ask for the table or for its shapes (.npz, .h5), or name a surface.",
        )
    return surface.template


def _lowest(surface: _Surface, n_modes: int) -> VibrationModes:
    if surface.lattice is not None:
        return lattice_modes(surface.lattice, n_modes)
    return surface_modes(_template(surface), n_modes)


def _terms(terms: tuple[str, ...]) -> tuple[list[ModeLabel], list[float]]:
    labels: list[ModeLabel] = []
    amplitudes = []
    for term in terms:
        name, _, value = term.rpartition("=")
        labels.append(topologies.parse_label(name))
        try:
            amplitudes.append(float(value))
        except ValueError:
            raise errors.ParameterError(
                f"{value[:40]!r} in {term[:60]!r} is not an amplitude.",
                remedy="Write LABEL=AMPLITUDE, such as 1,1,cos=5.",
            ) from None
    return labels, amplitudes


def _write_modes(
    output: Path, surface: _Surface, vibration_modes: VibrationModes, direction: Direction
) -> None:
    from modalmotion.exports.animation import modes_to_hdf5, modes_to_npz, one_by_one

    if output.suffix.lower() in (".npz", ".h5"):
        is_npz = output.suffix.lower() == ".npz"
        write = modes_to_npz if is_npz else modes_to_hdf5
        store.write_atomic(output, write(vibration_modes))
    elif output.suffix.lower() == ".glb":
        template = _template(surface)
        along = directions_on(template, direction)
        motion = one_by_one(template, vibration_modes, along, surface.unit)
        store.write_atomic(output, formats.write_glb(motion.morph_animation()))
    else:
        from modalmotion.pictures.modes import modes_figure

        shared.write_picture(modes_figure(_template(surface), vibration_modes), output)


def _write_animation(output: Path, template: Template, motion: Any, step: float) -> None:
    from modalmotion.exports.signature_pack import SUFFIXES, SurfaceFormat, write_surfaces

    if output.suffix.lower() in SUFFIXES:
        form = SUFFIXES[output.suffix.lower()]
        if form == SurfaceFormat.GLB:
            store.write_atomic(output, formats.write_glb(motion.morph_animation()))
            return
        fields = {"displacement": np.stack([*motion.heights()])}
        store.write_atomic(output, write_surfaces(motion.sequence(), form, fields))
        return
    from modalmotion.pictures.modes import Extent, draw_frames, write_gif

    extent = Extent(template, motion.positions(), motion.heights())
    pictures = draw_frames(template, motion.positions(), motion.heights(), extent)
    store.write_atomic(output, write_gif(pictures, step))
