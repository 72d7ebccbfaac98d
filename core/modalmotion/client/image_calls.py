"""Images: sent, described and deleted; `make_track` tracks them."""

from __future__ import annotations

from collections.abc import Iterator

from modalmotion.client.answers import ImagesInfo, value_of
from modalmotion.client.bodies import Source, body_of
from modalmotion.client.calls import Calls
from modalmotion.client.connection import Call
from modalmotion.client.query import segment
from modalmotion.progress import Progress


class ImageCalls(Calls):
    """Images: sent, described and deleted."""

    def upload_images(self, source: Source, *, progress: Progress | None = None) -> ImagesInfo:
        """Send images to be tracked: `make_track(images)` does, and deletes them.

        Parameters
        ----------
        source : path or bytes
            NIfTI, NRRD, MetaImage, or a zip of DICOM slices or of such files.
        progress : callable, optional
            Called with the bytes sent so far and those to send in all.

        Raises
        ------
        RemoteError
            If they cannot be read; names limit and remedy.
        UnreachableError
            If no answer comes. Sent again, they are stored once.
        """
        call = Call("POST", "/v1/images", body=body_of(source), is_keyed=True)
        return self._sent(call, lambda answer: value_of(ImagesInfo, answer.json), progress)

    def all_images(self, *, page: int = 100) -> Iterator[ImagesInfo]:
        """List images from the newest to the oldest, fetched a page at a time."""
        members = self._pages("/v1/images", "images", limit=page)
        return (value_of(ImagesInfo, member) for member in members)

    def images(self, images_id: str) -> ImagesInfo:
        """Describe images.

        Raises
        ------
        NotFoundError
            If there are none of that id: they are deleted after tracking, where nobody keeps them.
        """
        return value_of(ImagesInfo, self._get(_path(images_id)).json)

    def delete_images(self, images_id: str) -> None:
        """Delete images; tracks that were made of them stay."""
        self._connection.send(Call("DELETE", _path(images_id)))


def _path(images_id: str) -> str:
    return f"/v1/images/{segment(images_id)}"
