"""All forms of a report in one zip."""

from __future__ import annotations

import asyncio
import zipfile
from pathlib import Path
from typing import Final

from modalmotion_service.http.negotiation import CSV, FHIR, PDF
from modalmotion_service.schemas import ClassificationRequest, SignatureQuery
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.models import Models
from modalmotion_service.workspace.spool import Spool, remove_with_beside

_FORMS: Final = {"report.pdf": PDF, "report.fhir.json": FHIR, "frames.csv": CSV}
_PAGE: Final = "view.html"

# A zip knows no time before.
_NO_DATE: Final = (1980, 1, 1, 0, 0, 0)


async def whole_report(
    sequence_id: str, model: str | None, analysis: Analysis, models: Models, spool: Spool
) -> Path:
    """Write every form of a report on a stored sequence into a zip, which the caller removes.

    Parameters
    ----------
    sequence_id : str
    model : str or None
        Whose class is reported, and kept.
    analysis : Analysis
    models : Models
    spool : Spool

    Raises
    ------
    NotFoundError
        If there is no such sequence or model.
    """
    known = None
    if model is not None:
        chosen = await asyncio.to_thread(models.choose_for, model, sequence_id)
        coverage = ClassificationRequest().coverage
        known, _is_new = await models.classification(sequence_id, chosen, coverage)
    parameters, _facts = analysis.resolved(sequence_id, SignatureQuery().parameters())
    path = None if known is None else known.path
    forms = {
        name: await analysis.report(sequence_id, parameters, path, media_type)
        for name, media_type in _FORMS.items()
    }
    page = await analysis.view(sequence_id, parameters, as_page=True)
    output = spool.new_path()
    try:
        await asyncio.to_thread(_zip, output, forms, page)
    except BaseException:
        remove_with_beside(output)
        raise
    finally:
        page.unlink(missing_ok=True)
    return output


def _zip(output: Path, forms: dict[str, bytes], page: Path) -> None:
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in (*forms.items(), (_PAGE, page.read_bytes())):
            archive.writestr(
                zipfile.ZipInfo(name, _NO_DATE), data, compress_type=zipfile.ZIP_DEFLATED
            )
