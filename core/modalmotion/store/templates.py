"""Templates and norms in a store: each is there or not, without a row in the index."""

from __future__ import annotations

from pathlib import Path

from modalmotion.classification.card import is_model_name, require_model_name
from modalmotion.errors import NotFoundError, ParameterError, StoreError
from modalmotion.hdf5.sealed import is_sound, load_sealed
from modalmotion.norm.norm import Norm, norm_from_hdf5, norm_to_hdf5
from modalmotion.store.deletion import bury_and_remove, digest_of_norm
from modalmotion.store.folder import is_id
from modalmotion.store.opening import Opening
from modalmotion.store.sequences import SequenceStore


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


class NormStore(Opening):
    """Norms in a folder. Like a template a norm has no row in the index: it is there or not."""

    def put_norm(self, norm: Norm) -> bool:
        """Keep a norm; a name is one norm's until that is deleted.

        Returns
        -------
        bool
            True if it was not known before.

        Raises
        ------
        ParameterError
            If the name cannot be kept, or is another norm's.
        StoreError
            If it cannot be written; the store is as it was.
        """
        path = self._folder.norm(require_model_name(norm.name))
        with self._changing(digest_of_norm(norm.name)):
            known = norm_from_hdf5(path).id if is_sound(path) else None
            if known is None:
                self._write([(path, norm_to_hdf5(norm))], lambda: None)
        if known not in (None, norm.id):
            raise ParameterError(
                f"There is another norm named {norm.name!r}.",
                remedy="Choose another name, or delete that norm first.",
                details={"norm": norm.name},
            )
        return known is None

    def put_norm_image(self, image: Path) -> Norm:
        """Keep a norm that another process has written with `norm_to_hdf5`.

        Parameters
        ----------
        image : Path
            Sealed HDF5 file; what it holds is copied.

        Raises
        ------
        ParameterError, StoreError
            As `put_norm` does.
        CorruptFileError
            If the image is not whole.
        """
        norm = norm_from_hdf5(image)
        self.put_norm(norm)
        return norm

    def norm_path(self, name: str) -> Path:
        """HDF5 file of a norm.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        self._open_index()
        if not is_model_name(name) or not self._folder.norm(name).is_file():
            raise NotFoundError(
                f"There is no norm named {str(name)[:80]!r}.",
                remedy="Use one that is listed, or make it of your controls.",
                details={"norm": str(name)[:80]},
            )
        return self._folder.norm(name)

    def norm(self, name: str) -> Norm:
        """Read a norm.

        Raises
        ------
        NotFoundError
            If there is none.
        CorruptFileError
            If its file is damaged.
        """
        return norm_from_hdf5(self.norm_path(name))

    def norms(self) -> tuple[str, ...]:
        """Names of all norms, sorted."""
        self._open_index()
        return tuple(self._folder.norms())

    def delete_norm(self, name: str) -> None:
        """Delete a norm; its name is free again.

        Raises
        ------
        NotFoundError
            If there is none.
        StoreError
            If its file cannot be removed.
        """
        digest = digest_of_norm(name)
        with self._changing(digest):
            bury_and_remove(self.root, digest, self.norm_path(name))
