"""Templates of one owner: made from uploads, described and drawn."""

from __future__ import annotations

import asyncio

from modalmotion.signature.making import SignatureParameters
from modalmotion.stopwatch import StageReport
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.schemas import ModesQuery, TemplateAnswer
from modalmotion_service.work.tasks import templates
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.owner_work import OwnerWork
from modalmotion_service.workspace.shared_work import unheard


class TemplateWork(OwnerWork):
    """Makes, describes and draws templates."""

    async def template(
        self, upload: Upload, parameters: SignatureParameters, report: StageReport = unheard
    ) -> tuple[TemplateAnswer, bool]:
        """Make and store the template of an upload; tell whether it is new."""

        async def make(tell: StageReport) -> tuple[TemplateAnswer, bool]:
            with self.image() as image, stage("worker"):
                work = self.followed(tell, templates.make_template, upload, parameters, image)
                answer, milliseconds = await work
                add_milliseconds(milliseconds)
                with stage("store"):
                    is_new = await asyncio.to_thread(
                        self._store.put_template_image, image, answer.id
                    )
            return answer, is_new

        return await self._shared_work.join(("template", upload.path), make, report)

    async def describe_template(self, template_id: str) -> TemplateAnswer:
        """Describe a stored template."""
        path = await asyncio.to_thread(self._store.template_path, template_id)
        return await self.work(templates.describe_template, path)

    async def draw_template(self, template_id: str) -> bytes:
        """Draw the natural coordinates of a stored template, as PNG."""
        path = await asyncio.to_thread(self._store.template_path, template_id)
        return await self.work(templates.draw_template, path)

    async def template_modes(self, template_id: str, query: ModesQuery, media_type: str) -> bytes:
        """Give the vibration modes of a stored template as the media type."""
        path = await asyncio.to_thread(self._store.template_path, template_id)
        with stage("modes"):
            return await self.work(templates.modes_of_template, path, query, media_type)
