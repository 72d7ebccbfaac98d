"""Templates: natural coordinates that many sequences of one mesh share."""

from __future__ import annotations

from pathlib import Path

from modalmotion.client.answers import TemplateInfo, value_of
from modalmotion.client.bodies import Source, body_of
from modalmotion.client.calls import PNG, Calls, save
from modalmotion.client.connection import Call
from modalmotion.client.errors import understood
from modalmotion.client.query import Option, segment
from modalmotion.progress import Progress


class TemplateCalls(Calls):
    """Templates: natural coordinates that many sequences of one mesh share."""

    def make_template(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> TemplateInfo:
        """Make the template of a sequence's reference frame, and keep it.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            How to read the file; topology, reference, weights, apex, base, theta_zero, ...
        """
        call = Call("POST", "/v1/templates", options, body=body_of(source), is_repeatable=True)
        return value_of(TemplateInfo, self._connection.send(call, progress).json)

    def templates(self) -> list[str]:
        """List the ids of all templates."""
        answer = self._get("/v1/templates").json
        with understood("list of templates"):
            return [str(template_id) for template_id in answer["templates"]]

    def template(self, template_id: str) -> TemplateInfo:
        """Say what was found of a surface."""
        return value_of(TemplateInfo, self._get(f"/v1/templates/{segment(template_id)}").json)

    def save_template_picture(self, template_id: str, path: str | Path) -> None:
        """Write a picture of s and theta on the surface, as PNG."""
        save(self._get(f"/v1/templates/{segment(template_id)}", accept=PNG).content, Path(path))

    def delete_template(self, template_id: str) -> None:
        """Delete a template; signatures that were fitted on it stay."""
        self._connection.send(Call("DELETE", f"/v1/templates/{segment(template_id)}"))
