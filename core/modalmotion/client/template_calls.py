"""Templates: natural coordinates that many sequences of one mesh share."""

from __future__ import annotations

from pathlib import Path

from modalmotion.client.answers import (
    TemplateInfo,
    TemplateModes,
    template_modes_of,
    value_of,
)
from modalmotion.client.bodies import Source, body_of
from modalmotion.client.calls import HDF5, NPZ, PNG, Calls, require_place, require_suffix, save
from modalmotion.client.connection import Call
from modalmotion.client.errors import understood
from modalmotion.client.query import Option, segment
from modalmotion.progress import Progress


class TemplateCalls(Calls):
    """Templates: natural coordinates that many sequences of one mesh share."""

    def make_template(
        self, source: Source, *, progress: Progress | None = None, **options: Option
    ) -> TemplateInfo:
        """Make the template of a sequence's reference frame, and store it.

        Parameters
        ----------
        source : path, bytes or MeshSequence
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.
        **options
            How to read the file; topology, reference, weights, apex, base, theta_zero,
            merge_vertices, ...
        """
        call = Call("POST", "/v1/templates", options, body=body_of(source), is_repeatable=True)
        return self._sent(call, lambda answer: value_of(TemplateInfo, answer.json), progress)

    def templates(self) -> list[str]:
        """List the ids of all templates."""
        answer = self._get("/v1/templates").json
        with understood("a list of templates"):
            return [str(template_id) for template_id in answer["templates"]]

    def template(self, template_id: str) -> TemplateInfo:
        """Describe a template."""
        return value_of(TemplateInfo, self._get(f"/v1/templates/{segment(template_id)}").json)

    def save_template_picture(self, template_id: str, path: str | Path) -> None:
        """Write a picture of s and theta on the surface, as PNG."""
        target = Path(path)
        require_place(target)
        save(self._get(f"/v1/templates/{segment(template_id)}", accept=PNG).content, target)

    def template_modes(self, template_id: str, modes: int = 7, **options: Option) -> TemplateModes:
        """Return labels, angular frequencies and shapes of the vibration modes of a surface.

        Parameters
        ----------
        template_id : str
        modes : int
            How many; no pair is split.
        **options
            wave_speed, in length units per s: 1 by default.
        """
        answer = self._get(_modes(template_id), {"modes": modes, **options}, NPZ)
        return template_modes_of(answer)

    def save_template_modes(
        self, template_id: str, path: str | Path, modes: int = 7, **options: Option
    ) -> None:
        """Write the vibration modes of a surface: a picture (.png), or data (.npz, .h5)."""
        target = Path(path)
        accept = require_suffix(target, {".png": PNG, ".npz": NPZ, ".h5": HDF5})
        query = {"modes": modes, **options}
        save(self._get(_modes(template_id), query, accept).content, target)

    def delete_template(self, template_id: str) -> None:
        """Delete a template; signatures that were fitted on it stay."""
        self._connection.send(Call("DELETE", f"/v1/templates/{segment(template_id)}"))


def _modes(template_id: str) -> str:
    return f"/v1/templates/{segment(template_id)}/modes"
