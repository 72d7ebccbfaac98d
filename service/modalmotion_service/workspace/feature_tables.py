"""Tables of features of stored sequences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from modalmotion.classification import CaseFile, TrainingOptions
from modalmotion.classification.cases import UNUSABLE, LeftOut, case_name, named
from modalmotion.errors import ModeCountError, TopologyError, UnlikeCasesError
from modalmotion.mesh import Named
from modalmotion.progress import StageReport
from modalmotion.signature.making import SignatureParameters
from modalmotion_service.errors import CostError
from modalmotion_service.work.tasks import features
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.shared_work import unheard
from modalmotion_service.workspace.spool import Spool, remove_with_beside
from modalmotion_service.workspace.training_set import Case

# Part of a table that fitting the signatures is counted as.
_FITTING = 0.9


class FeatureTables:
    """Makes tables of features.

    Parameters
    ----------
    analysis : Analysis
        Makes the signatures that are missing; its workers read the features.
    spool : Spool
        Where tables are written.
    """

    def __init__(self, analysis: Analysis, spool: Spool) -> None:
        self._analysis = analysis
        self._spool = spool

    async def make(
        self,
        cases: Sequence[Case],
        options: Mapping[str, Any],
        media_type: str,
        report: StageReport = unheard,
        *,
        leaves_out: bool,
    ) -> tuple[Path, int]:
        """Write the features of sequences to a file, which the caller removes.

        Parameters
        ----------
        cases : sequence of Case
        options : mapping
            Of `SignatureFeatures`.
        media_type : str
        report : StageReport
        leaves_out : bool
            Whether sequences that do not fit are left out.

        Returns
        -------
        Path, int
            The file, and the number of sequences that were left out.

        Raises
        ------
        ModalMotionError
            If one cannot be fitted, they do not compare, or an option cannot be met.
        """
        own = TrainingOptions(
            modes=options["modes"], topology=options["topology"]
        ).signature_parameters

        # As `feature_table` does it where the sequences are at hand.
        attempts = [(own, False)]
        if own.topology is None:
            attempts.append((replace(own, closed_form=False), False))
        if leaves_out:
            attempts.append((own, True))
        unlike: UnlikeCasesError | None = None
        for number, (parameters, drops_unlike) in enumerate(attempts):
            try:
                files, left_out = await self._fit(
                    cases, parameters, report, leaves_out=leaves_out and number != 1
                )
                on_error = "leave out" if drops_unlike else "raise"
                return await self._write(files, options, on_error, left_out, media_type)
            except UnlikeCasesError as error:
                unlike = unlike or error
            except (TopologyError, ModeCountError):
                if unlike is None:
                    raise
        raise unlike or UnlikeCasesError("The sequences do not compare.")

    async def _fit(
        self,
        cases: Sequence[Case],
        parameters: SignatureParameters,
        report: StageReport,
        *,
        leaves_out: bool,
    ) -> tuple[list[CaseFile], list[LeftOut]]:
        files: list[CaseFile] = []
        left_out: list[LeftOut] = []
        for done, case in enumerate(cases):
            report(_FITTING * done / len(cases), f"signature {done + 1} of {len(cases)}")
            try:
                path = await self._analysis.signature(case.id, parameters)
            except (*UNUSABLE, CostError) as error:
                if not leaves_out:
                    raise named(error, case_name(case.id), sequence_id=case.id) from error
                left_out.append(LeftOut.of(error, case_name(case.id)))
            else:
                stated = case.label, case.subject, Named(case.covariates)
                files.append(CaseFile(path, case.id, *stated))
        report(_FITTING, "features")
        return files, left_out

    async def _write(
        self,
        files: list[CaseFile],
        options: Mapping[str, Any],
        on_error: str,
        left_out: list[LeftOut],
        media_type: str,
    ) -> tuple[Path, int]:
        output = self._spool.new_path()
        work = files, dict(options), on_error, left_out, media_type, output
        try:
            return output, await self._analysis.work(features.tabulate, *work)
        except BaseException:
            # Also removes a dead worker's leftovers.
            remove_with_beside(output)
            raise
