"""Tables of features of kept signatures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from modalmotion.classification import CaseFile, feature_table
from modalmotion.classification.cases import LeftOut
from modalmotion_service.http.negotiation import CSV
from modalmotion_service.schemas.models import FeaturesAnswer
from modalmotion_service.work.tasks.files import write_whole


def tabulate(
    cases: Sequence[CaseFile],
    options: dict[str, Any],
    on_error: str,
    left_out: Sequence[LeftOut],
    media_type: str,
    output: Path,
) -> int:
    """Write the features of kept signatures as CSV or JSON; gives the number of cases left out.

    Parameters
    ----------
    cases : sequence of CaseFile
    options : dict
        Of `SignatureFeatures`.
    on_error : str
    left_out : sequence of LeftOut
        Cases whose signatures could not be made.
    media_type : str
    output : Path

    Raises
    ------
    ModalMotionError
        If they do not compare, or have not the features that the options name.
    """
    # Here, for the server, which only hands this on, needs no scikit-learn.
    from modalmotion.classification import SignatureFeatures

    table = feature_table(cases, SignatureFeatures(**options), on_error=on_error)
    table = table.beside(left_out)
    text = table.as_csv() if media_type == CSV else FeaturesAnswer.of(table).model_dump_json()
    write_whole(output, text.encode())
    return len(table.left_out)
