"""Norms of the service: made of stored controls, and asked about stored sequences."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from pydantic_core import from_json

from modalmotion.classification import TrainingOptions
from modalmotion.classification.cases import case_name, named
from modalmotion.errors import (
    ModalMotionError,
    ModeCountError,
    ParameterError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.mesh import Facts
from modalmotion.norm import Norm
from modalmotion.norm.norm import parameters_of_controls
from modalmotion.progress import StageReport
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import ResultStore
from modalmotion_service.errors import ConflictError
from modalmotion_service.schemas.models import CohortDeviationAnswer
from modalmotion_service.work.tasks import norms
from modalmotion_service.work.tasks.norms import KeptRecording
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.shared_work import unheard
from modalmotion_service.workspace.training_set import Case

# Part of making a norm that fitting the signatures is counted as.
_FITTING: Final = 0.8

LEAST_TOGETHER: Final = 5
"""Recordings that are compared as a cohort."""


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
            controls = [
                await self._fitted(case, own, wanted, _part_of(report, number, len(cases)))
                for number, (case, own) in enumerate(zip(cases, facts, strict=True))
            ]

            def tell(share: float, text: str) -> None:
                report(_FITTING + (1 - _FITTING) * share, text)

            with self._analysis.image() as image:
                await self._analysis.followed(
                    tell, norms.make_norm, controls, name, modes, topology, image
                )
                return await asyncio.to_thread(self._store.put_norm_image, image)

        try:
            return await make_with(parameters)
        except UnlikeCasesError as unlike:
            # As `in_one_basis` does it where the sequences are at hand.
            if topology is not None:
                raise
            try:
                return await make_with(replace(parameters, closed_form=False))
            except (UnlikeCasesError, TopologyError, ModeCountError):
                raise unlike from None
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
        if len(cases) >= LEAST_TOGETHER:
            return await self.together(cases, name, level, report)
        norm = await asyncio.to_thread(self._store.norm, name)
        alone = [from_json(await self.deviation(case, name, level)) for case in cases]
        answer = CohortDeviationAnswer(
            norm=norm.name,
            norm_id=norm.id,
            n_controls=norm.as_json()["n_controls"],
            n_recordings=len(cases),
            level=level,
            p=None,
            is_another=None,
            warning=None,
            deviations=alone,
        )
        return answer.model_dump_json().encode()

    async def deviation(self, case: Case, name: str, level: float) -> bytes:
        """Compare a stored sequence with a norm; gives JSON.

        Raises
        ------
        NotFoundError
            If there is no such norm or sequence.
        ModalMotionError
            If it does not compare.
        """
        norm = await asyncio.to_thread(self._store.norm, name)
        path = self._store.norm_path(name)
        facts, topology = self._facts(case), self._store.sequence_record(case.id).topology
        parameters: SignatureParameters = norm.readable.parameters
        recording = await self._fitted(case, facts, parameters, unheard)

        async def compared(stated: str | None) -> tuple[bytes, str | None]:
            return await self._analysis.work(norms.ask_norm, recording, path, level, stated)

        answer, imposed = await compared(topology)
        if imposed is not None:
            # As `fitted_in` does it where a sequence is at hand.
            with contextlib.suppress(TopologyError):
                wanted = replace(parameters, topology=imposed)
                recording = await self._fitted(case, facts, wanted, unheard)
            answer, _ = await compared(imposed)
        return answer

    async def together(
        self, cases: Sequence[Case], name: str, level: float, report: StageReport = unheard
    ) -> bytes:
        """Compare stored sequences with a norm, each and together; gives JSON.

        Raises
        ------
        NotFoundError
            If there is no such norm or sequence.
        ModalMotionError
            If one does not compare, or there are too few.
        """
        norm = await asyncio.to_thread(self._store.norm, name)
        path = self._store.norm_path(name)
        parameters: SignatureParameters = norm.readable.parameters
        facts = [self._facts(case) for case in cases]
        recordings = [
            await self._fitted(case, own, parameters, _part_of(report, number, len(cases)))
            for number, (case, own) in enumerate(zip(cases, facts, strict=True))
        ]
        stated = [self._store.sequence_record(case.id).topology for case in cases]
        answer, imposed = await self._analysis.work(
            norms.ask_norm_together, recordings, path, level, stated
        )
        if imposed:
            for number, topology in imposed.items():
                with contextlib.suppress(TopologyError):
                    wanted = replace(parameters, topology=topology)
                    recordings[number] = await self._fitted(
                        cases[number], facts[number], wanted, unheard
                    )
                stated[number] = topology
            answer, _ = await self._analysis.work(
                norms.ask_norm_together, recordings, path, level, stated
            )
        return answer

    def _facts(self, case: Case) -> Facts:
        return replace(self._store.sequence_record(case.id).facts, covariates=case.covariates)

    async def _fitted(
        self, case: Case, facts: Facts, parameters: SignatureParameters, report: StageReport
    ) -> KeptRecording:
        try:
            signature = await self._analysis.signature(case.id, parameters, report)
        except ModalMotionError as error:
            raise named(error, case_name(case.id), sequence_id=case.id) from error
        vertices = None
        if self._store.sequence_record(case.id).has_upload:
            vertices = await asyncio.to_thread(self._store.sequence_path, case.id)
        return KeptRecording(case.id, signature, vertices, facts, case.subject)


def _part_of(report: StageReport, number: int, total: int) -> Callable[[float, str], None]:
    def tell(share: float, text: str) -> None:
        report(_FITTING * (number + share) / total, f"signature {number + 1} of {total}: {text}")

    return tell
