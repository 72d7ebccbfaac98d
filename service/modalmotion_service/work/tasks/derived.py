"""What follows from a signature, or from many: volumes, surfaces, the trade."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.clinical import clinical_readouts
from modalmotion.clinical.ventricle import ventricle_readouts
from modalmotion.errors import ParameterError
from modalmotion.exports.signature_pack import SurfaceFormat, write_superposed
from modalmotion.exports.tables import frame_table
from modalmotion.mesh import Facts
from modalmotion.pictures.readouts import volume_figure
from modalmotion.progress import Stopwatch
from modalmotion.signature import measure_tradeoff
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.tradeoff import as_plain
from modalmotion.store import sequence_from_hdf5, signature_from_hdf5, template_from_hdf5
from modalmotion.template.body_frame import Components
from modalmotion_service.http.negotiation import CSV, PNG
from modalmotion_service.schemas.readouts import ReadoutsAnswer
from modalmotion_service.schemas.signatures import TradeoffAnswer
from modalmotion_service.work.fitted import Fitted
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import png_of, whole_file, write_whole

STRAIN: Final = "strain"
"""In place of a media type: the strain alone, as JSON."""


def read_out(one: Fitted, how: str) -> bytes:
    """Read volumes and strain from a kept signature, as JSON, PNG or a table; or `STRAIN` alone.

    Raises
    ------
    ParameterError
        If the strain is asked for, and the surface has none.
    """
    fitted, loaded, named = one.read_signature(), one.read_sequence(), one.read_template()
    result = clinical_readouts(fitted, loaded, template=named)
    if how == PNG:
        return png_of(volume_figure(result))
    ventricle = ventricle_readouts(fitted, loaded, result, template=named)
    if how == CSV:
        return frame_table(fitted, result, ventricle).to_csv().encode()
    answer = ReadoutsAnswer.of(result, ventricle)
    if how == STRAIN:
        if answer.strain is None:
            raise ParameterError(
                " ".join(ventricle.reasons) or "The surface is no wall with a strain.",
                remedy="Ask for the strain of a surface with coordinates along and around it.",
            )
        return answer.strain.model_dump_json().encode()
    return answer.model_dump_json().encode()


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
    one: Fitted,
    surface_format: SurfaceFormat,
    times: list[float] | None,
    phases: list[float] | int | None,
    max_targets: int | None,
    output: Path,
) -> None:
    """Write the surfaces that a signature stands for."""
    write_whole(
        output,
        write_superposed(
            signature_from_hdf5(one.signature),
            sequence_from_hdf5(one.sequence),
            surface_format,
            template=one.read_template(),
            times=None if times is None else np.array(times),
            phases=phases,
            max_targets=max_targets,
        ),
    )
