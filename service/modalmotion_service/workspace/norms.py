"""Norms made of stored controls and asked, and tables of features of stored sequences."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from modalmotion.classification import CaseFile, TrainingOptions
from modalmotion.classification.cases import UNUSABLE, LeftOut, case_name, named
from modalmotion.errors import (
    ModalMotionError,
    ModeCountError,
    ParameterError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.mesh.facts import Facts, Named
from modalmotion.modes.topology import MESH
from modalmotion.norm import Norm
from modalmotion.norm.training import parameters_of_controls
from modalmotion.progress import StageReport
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import ResultStore
from modalmotion_service.errors import ConflictError, CostError
from modalmotion_service.work.tasks import classification
from modalmotion_service.work.tasks.classification import KeptRecording
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.owner_work import in_one_basis, unheard
from modalmotion_service.workspace.spool import Spool, remove_with_beside
from modalmotion_service.workspace.training import Case

# Part of making a norm that fitting the signatures is counted as.
_FITTING: Final = 0.8


class Norms:
    """Makes and asks norms.

    Parameters
    ----------
    store : ResultStore
    analysis : Analysis
        Makes the signatures that are compared; its workers read them.
    """

    def __init__(self, store: ResultStore, analysis: Analysis) -> None:
        self._store = store
        self._analysis = analysis

    def require_free(self, name: str) -> None:
        """Check that no norm has this name.

        Raises
        ------
        ConflictError
            If one has.
        """
        if name in self._store.norms():
            raise ConflictError(
                f"There is a norm named {name!r}.",
                remedy=f"Choose another name, or DELETE /v1/norms/{name} first.",
                details={"norm": name},
            )

    async def make(
        self,
        name: str,
        cases: Sequence[Case],
        modes: int,
        topology: str | None,
        report: StageReport = unheard,
    ) -> Norm:
        """Make a norm of stored controls and keep it.

        Raises
        ------
        ConflictError
            If another norm has the name by now.
        ModalMotionError
            If a control was deleted or cannot be fitted, or no norm can be made of them.
        """
        options = TrainingOptions(modes=modes, topology=topology)
        facts = [self._facts(case) for case in cases]
        parameters = parameters_of_controls(options.signature_parameters, facts)

        async def make_with(wanted: SignatureParameters) -> Norm:
            controls = await self._fitted_each(cases, facts, wanted, report)

            def tell(share: float, text: str) -> None:
                report(_FITTING + (1 - _FITTING) * share, text)

            with self._analysis.image() as image:
                await self._analysis.followed(
                    tell, classification.make_norm, controls, name, modes, topology, image
                )
                return await asyncio.to_thread(self._store.put_norm_image, image)

        try:
            return await in_one_basis(make_with, parameters)
        except ParameterError as error:
            if "norm" not in error.details:
                raise
            raise ConflictError(
                error.message, remedy=error.remedy, details=error.details
            ) from error

    async def ask(
        self, cases: Sequence[Case], name: str, level: float, report: StageReport = unheard
    ) -> bytes:
        """Compare stored sequences with a norm, each, and from five on together; gives JSON.

        Raises
        ------
        NotFoundError
            If there is no such norm or sequence.
        ModalMotionError
            If one does not compare.
        """
        norm = await asyncio.to_thread(self._store.norm, name)
        path = self._store.norm_path(name)
        parameters: SignatureParameters = norm.readable.parameters
        facts = [self._facts(case) for case in cases]
        recordings = await self._fitted_each(cases, facts, parameters, report)
        stated = [self._store.sequence_record(case.id).topology for case in cases]
        answer, imposed = await self._analysis.work(
            classification.ask_norm, recordings, path, level, stated
        )
        if imposed:
            # As `fitted_in` does it where a sequence is at hand.
            for number, topology in imposed.items():
                with contextlib.suppress(TopologyError):
                    wanted = replace(parameters, topology=topology)
                    recordings[number] = await self._fitted(cases[number], facts[number], wanted)
                stated[number] = topology
            answer, _ = await self._analysis.work(
                classification.ask_norm, recordings, path, level, stated
            )
        return answer

    def _facts(self, case: Case) -> Facts:
        return replace(self._store.sequence_record(case.id).facts, covariates=case.covariates)

    async def _fitted_each(
        self,
        cases: Sequence[Case],
        facts: Sequence[Facts],
        parameters: SignatureParameters,
        report: StageReport,
    ) -> list[KeptRecording]:
        def tell(done: int, total: int) -> None:
            report(_FITTING * done / total, f"signature {done} of {total}")

        return await self._analysis.each(
            list(zip(cases, facts, strict=True)),
            lambda one: self._fitted(*one, parameters),
            tell,
        )

    async def _fitted(
        self, case: Case, facts: Facts, parameters: SignatureParameters
    ) -> KeptRecording:
        try:
            signature = await self._analysis.signature(case.id, parameters)
        except ModalMotionError as error:
            raise named(error, case_name(case.id), sequence_id=case.id) from error
        vertices = None
        if self._store.sequence_record(case.id).has_upload:
            vertices = await asyncio.to_thread(self._store.sequence_path, case.id)
        return KeptRecording(case.id, signature, vertices, facts, case.subject)


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
            attempts.append((replace(own, topology=MESH), False))
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

        async def fitted(case: Case) -> CaseFile | LeftOut:
            try:
                path = await self._analysis.signature(case.id, parameters)
            except (*UNUSABLE, CostError) as error:
                if not leaves_out:
                    raise named(error, case_name(case.id), sequence_id=case.id) from error
                return LeftOut.of(error, case_name(case.id))
            return CaseFile(path, case.id, case.label, case.subject, Named(case.covariates))

        def tell(done: int, total: int) -> None:
            report(_FITTING * done / total, f"signature {done} of {total}")

        made = await self._analysis.each(cases, fitted, tell)
        report(_FITTING, "features")
        return (
            [one for one in made if isinstance(one, CaseFile)],
            [one for one in made if isinstance(one, LeftOut)],
        )

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
            return output, await self._analysis.work(classification.tabulate_features, *work)
        except BaseException:
            # Also removes a dead worker's leftovers.
            remove_with_beside(output)
            raise
