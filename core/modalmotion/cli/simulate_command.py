"""Commands that simulate ventricles: one, by every parameter of the model; or a cohort."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Final

import click
import numpy as np
from click.core import ParameterSource

from modalmotion import formats, store
from modalmotion.cli import files, shared
from modalmotion.formats.volumes.one_file import write_nifti, write_nifti_zip
from modalmotion.representation import csv_text
from modalmotion.simulate import (
    Acquisition,
    ImageKind,
    MotionClass,
    VentricleParameters,
    simulate_images,
    simulate_ventricle,
)
from modalmotion.simulate import simulate_cohort as cohort

_STATED: Final = ("tracking", "handedness", "period", "cavity", "modality")
"""Facts that the simulator knows."""


@shared.command("simulate -o beat.npz --ejection-fraction 0.4")
@shared.options_of(
    VentricleParameters, *(one.name for one in fields(VentricleParameters)), group=shared.VENTRICLE
)
def simulate(
    output: Annotated[Path, shared.OutputFile()],
    frames: int = 25,
    noise: float = 0.0,
    grid: Annotated[tuple[int, ...] | None, {"default": "32,64"}] = None,
    vertices: int | None = None,
    seed: int = 0,
    image: ImageKind | None = None,
    **parameters: Any,
) -> Any:
    """Simulate one heartbeat of a left ventricle.

    The motion is kinematic: ejection fraction, shortening, torsion and timing follow known
    physiology; no mechanics is solved.

    Parameters
    ----------
    output
        File to write (.npz; of images .zip, or .nii.gz, which cannot contain planes).
    frames
        Frames over one beat.
    noise
        Standard deviation of coordinates of a surface, mm.
    grid
        Lattice shape of a surface.
    vertices
        Triangulate this many vertices, instead of a lattice.
    seed
        Seed of all random numbers.
    image
        Images instead of a surface, or a label map; the true surface and landmarks beside them.
    """
    if grid is None or len(grid) != 2:
        raise click.BadParameter("A ventricle's lattice has two axes.", param_hint="--grid")
    if image is not None:
        source = click.get_current_context().get_parameter_source
        for name in ("noise", "grid", "vertices"):
            if source(name) is ParameterSource.COMMANDLINE:
                raise click.UsageError(f"--{name} is for surfaces: leave it out with --image.")
        parts = _write_images(output, image, VentricleParameters(**parameters), frames, seed)
        return {"n_frames": frames, "image": image.value, "unit": "mm", "written": parts}
    sequence = simulate_ventricle(
        VentricleParameters(**parameters),
        grid=(grid[0], grid[1]),
        n_vertices=vertices,
        acquisition=Acquisition(n_frames=frames, noise=noise),
        rng=np.random.default_rng(seed),
    )
    store.write_atomic(output, formats.write_npz(sequence))
    return shared.members(sequence, *shared.SEQUENCE)


def _write_images(
    output: Path, kind: ImageKind, parameters: VentricleParameters, frames: int, seed: int
) -> tuple[Path, Path, Path]:
    """Write images, and beside them what they show: .truth.npz and .landmarks.json."""
    ending = next((end for end in (".zip", ".nii.gz") if output.name.lower().endswith(end)), "")
    if not ending:
        raise click.BadParameter("Images are written as .zip or .nii.gz.", param_hint="--output")
    stem = output.name[: -len(ending)]
    if kind is ImageKind.CINE and ending != ".zip":
        raise click.BadParameter(
            f"The planes of a cine do not fit into one .nii.gz; write a zip: -o {stem}.zip.",
            param_hint="--output",
        )
    phantom = simulate_images(kind, parameters, n_frames=frames, rng=np.random.default_rng(seed))
    marks = {
        "coordinates": "LPS",
        "unit": "mm",
        "landmarks": {
            "apex": phantom.landmarks["apex"][0].tolist(),
            "base": phantom.landmarks["base"].tolist(),
        },
    }
    write = write_nifti_zip if ending == ".zip" else write_nifti
    store.write_atomic(output, write(phantom.images))
    truth, places = (output.with_name(stem + end) for end in (".truth.npz", ".landmarks.json"))
    store.write_atomic(truth, formats.write_npz(phantom.truth))
    store.write_atomic(places, json.dumps(marks).encode())
    return output, truth, places


@shared.command("simulate-cohort -o cohort --per-class 50")
def simulate_cohort(
    output: Annotated[Path, shared.OutputFolder()],
    per_class: Annotated[int, click.IntRange(min=1)] = 20,
    noise: float = 0.6,
    seed: int = 0,
) -> Any:
    """Simulate labelled ventricles that differ in motion, shape, mesh, frames and pose.

    Parameters
    ----------
    output
        Folder to write: files, and cases.csv with path, label, subject and facts.
    per_class
        Ventricles of each class.
    noise
        Standard deviation of coordinates, mm.
    seed
        Seed of all random numbers.
    """
    output.mkdir(parents=True, exist_ok=True)
    rows: list[list[object]] = [["path", "label", "subject", *_STATED]]
    total = per_class * len(MotionClass)
    cases = cohort(per_class, rng=np.random.default_rng(seed), noise=noise)
    with files.progress_bar(cases, length=total, label="ventricles") as bar:
        for number, case in enumerate(bar):
            name = f"ventricle-{seed}-{number:04d}"
            store.write_atomic(output / f"{name}.npz", formats.write_npz(case.sequence))
            facts = [getattr(case.sequence.facts, fact) for fact in _STATED]
            rows.append([f"{name}.npz", case.label, name, *facts])
    store.write_atomic(output / "cases.csv", csv_text(rows).encode())
    classes = [one.value for one in MotionClass]
    return {"n_cases": total, "classes": classes, "written": [output / "cases.csv"]}
