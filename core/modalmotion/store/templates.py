"""Templates in a store: named by their origin, apart from any sequence."""

from __future__ import annotations

from pathlib import Path

from modalmotion.errors import NotFoundError, StoreError
from modalmotion.hdf5.sealed import is_sound, load_sealed
from modalmotion.store.folder import is_id
from modalmotion.store.sequences import SequenceStore
from modalmotion.store.tombstones import bury_and_remove


class TemplateStore(SequenceStore):
    """A store of sequences that keeps templates too.

    A template is named by its origin, so it needs no row in the index: it is there
    or not.
    """

    def put_template_image(self, image: Path, template_id: str) -> bool:
        """Keep a template that another process has written with `template_to_hdf5`.

        Parameters
        ----------
        image : Path
            Sealed HDF5 file; it is copied.
        template_id : str

        Returns
        -------
        bool
            True if it was not known before.

        Raises
        ------
        StoreError
            If it cannot be written; the store is as it was.
        CorruptFileError
            If the image has no sound seal.
        """
        if not is_id(template_id):
            raise StoreError(
                f"A template cannot be kept as {str(template_id)[:12]!r}: that is not a digest.",
                remedy="Use the template's own id.",
            )
        path = self._folder.template(template_id)
        with self._changing(template_id):
            if is_sound(path):
                return False
            self._write([(path, load_sealed(image)[1])], lambda: None)
            return True

    def template_path(self, template_id: str) -> Path:
        """HDF5 file of a template.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        self._open_index()
        if not is_id(template_id) or not (path := self._folder.template(template_id)).is_file():
            raise NotFoundError(
                f"There is no template {str(template_id)[:12]!r}.",
                remedy="Use the id returned when it was made, or make it.",
            )
        return path

    def templates(self) -> tuple[str, ...]:
        """Ids of all templates, sorted."""
        self._open_index()
        return tuple(self._folder.templates())

    def delete_template(self, template_id: str) -> None:
        """Delete a template; signatures that were fitted on it stay.

        Raises
        ------
        NotFoundError
            If there is none.
        StoreError
            If its file cannot be removed.
        """
        with self._changing(template_id):
            bury_and_remove(self.root, template_id, self.template_path(template_id))
