"""What follows from a signature, or from many: volumes, surfaces, the trade."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.ventricle import ventricle_readouts
from modalmotion.exports.surfaces import SurfaceFormat, write_superposed
from modalmotion.exports.table import frame_table
from modalmotion.facts import Facts
from modalmotion.pictures.readouts import volume_figure
from modalmotion.signature.making import SignatureParameters
from modalmotion.stopwatch import Stopwatch
from modalmotion.store import sequence_from_hdf5, signature_from_hdf5, template_from_hdf5
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff import measure_tradeoff
from modalmotion.tradeoff.plain import as_plain
from modalmotion_service.http.negotiation import CSV, PNG
from modalmotion_service.schemas import ReadoutsAnswer, TradeoffAnswer
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import loaded_sequence, png_of, whole_file, write_whole


def read_out(
    sequence: Path,
    signature: Path,
    template: Path | None,
    media_type: str,
    facts: Facts,
    track: Path | None,
) -> bytes:
    """Read volume and ejection fraction from a kept signature, as JSON, PNG or a table."""
    fitted = signature_from_hdf5(signature)
    loaded = loaded_sequence(sequence, track).with_facts(facts)
    named = None if template is None else template_from_hdf5(template)
    result = clinical_readouts(fitted, loaded, template=named)
    if media_type == PNG:
        return png_of(volume_figure(result))
    ventricle = ventricle_readouts(fitted, loaded, result, template=named)
    if media_type == CSV:
        return frame_table(fitted, result, ventricle).to_csv().encode()
    return ReadoutsAnswer.of(result, ventricle).model_dump_json().encode()


# Parts of the whole.
_SHARES: Final = {"template": 0.1, "front": 0.5, "scene": 0.05, "choice": 0.2, "timing": 0.1}


def measure_trade(
    sequence: Path,
    parameters: SignatureParameters,
    front_modes: int,
    components: Components | None,
    template: Path | None,
    media_type: str,
    output: Path,
    facts: Facts,
    progress: Path,
) -> dict[str, float]:
    """Measure the trade on a kept sequence, as JSON or PNG; gives milliseconds by stage.

    `progress` is a `ProgressFile`.
    """
    found = measure_tradeoff(
        sequence_from_hdf5(sequence).with_facts(facts),
        parameters,
        most_modes=front_modes,
        components=None if components is None else (components,),
        template=None if template is None else template_from_hdf5(template),
        watch=Stopwatch(_SHARES, ProgressFile(progress).write),
    )
    with whole_file(output) as temporary:
        if media_type == PNG:
            from modalmotion.pictures.tradeoff import tradeoff_figure

            tradeoff_figure(found).savefig(temporary, format="png")
        else:
            temporary.write_text(TradeoffAnswer(**as_plain(found)).model_dump_json())
    return dict(found.milliseconds)


def superpose(
    sequence: Path,
    signature: Path,
    template: Path | None,
    surface_format: SurfaceFormat,
    times: list[float] | None,
    phases: list[float] | int | None,
    max_targets: int | None,
    output: Path,
) -> None:
    """Write the surfaces that a kept signature stands for."""
    write_whole(
        output,
        write_superposed(
            signature_from_hdf5(signature),
            sequence_from_hdf5(sequence),
            surface_format,
            template=None if template is None else template_from_hdf5(template),
            times=None if times is None else np.array(times),
            phases=phases,
            max_targets=max_targets,
        ),
    )
