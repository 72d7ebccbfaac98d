"""Norms of the service: made of stored controls, and asked about stored sequences."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from modalmotion.classification import TrainingOptions
from modalmotion.classification.cases import case_name, named
from modalmotion.errors import (
    ModalMotionError,
    ParameterError,
    TopologyError,
)
from modalmotion.facts import Facts
from modalmotion.norm import Norm
from modalmotion.norm.norm import parameters_of_controls
from modalmotion.signature.making import SignatureParameters
from modalmotion.stopwatch import StageReport
from modalmotion.store import ResultStore
from modalmotion_service.errors import ConflictError
from modalmotion_service.work.tasks import norms
from modalmotion_service.work.tasks.norms import KeptRecording
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.owner_work import in_one_basis, unheard
from modalmotion_service.workspace.training_set import Case

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
                    tell, norms.make_norm, controls, name, modes, topology, image
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
        answer, imposed = await self._analysis.work(norms.ask_norm, recordings, path, level, stated)
        if imposed:
            # As `fitted_in` does it where a sequence is at hand.
            for number, topology in imposed.items():
                with contextlib.suppress(TopologyError):
                    wanted = replace(parameters, topology=topology)
                    recordings[number] = await self._fitted(cases[number], facts[number], wanted)
                stated[number] = topology
            answer, _ = await self._analysis.work(norms.ask_norm, recordings, path, level, stated)
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
