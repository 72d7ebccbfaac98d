"""Models, templates and norms of a store."""

from pathlib import Path

from modalmotion.classification import card, model_files
from modalmotion.classification.model import Model
from modalmotion.errors import NotFoundError, ParameterError, StoreError
from modalmotion.hdf5.sealed import is_sound, load_sealed
from modalmotion.norm.norm import Norm, norm_from_hdf5, norm_to_hdf5
from modalmotion.store import deletion, disk, folders, sequences
from modalmotion.store.index import now
from modalmotion.store.opening import Opening


class ModelStore(Opening):
    """Models in a folder, each an immutable version of a name.

    Parameters
    ----------
    root : Path
        The folder; made where it is missing.
    """

    def put_model(self, model: Model | model_files.KeptModel) -> card.ModelRecord:
        """Keep a model as the next version of its name.

        Parameters
        ----------
        model : Model or KeptModel
            If it says which training made it, and that training has put one already, then
            that one is returned: a training that is begun again after a crash ends once.

        Returns
        -------
        ModelRecord
            With its version and time.

        Raises
        ------
        ParameterError
            If its name cannot be stored.
        StoreError
            If it cannot be written; the store is as it was.
        """
        stored_model = model_files.kept_model(model) if isinstance(model, Model) else model
        name = card.require_model_name(stored_model.record.name)
        index = self._open_index()
        with self._changing(name):
            training = stored_model.record.training
            known = None if training is None else self.model_of_training(training)
            if known is not None:
                return known
            # By the files, for one that is damaged has no row, and keeps its number.
            versions = [record.version for record in index.versions(name)]
            version = 1 + max(self._folder.last_version(name), *versions, 0)
            new_version = model_files.numbered(stored_model, version, now())
            path = self._folder.path("models", new_version.record.reference)
            self._write(
                [(path, model_files.model_to_hdf5(new_version))],
                lambda: index.put_model(new_version.record),
            )
            return new_version.record

    def model_record(self, name: str, version: int | None = None) -> card.ModelRecord:
        """Look up a version of a model, the newest by default.

        Raises
        ------
        NotFoundError
            If there is none, or it was deleted.
        """
        versions = self._open_index().versions(name) if card.is_model_name(name) else []
        remaining = [record for record in versions if record.deleted is None]
        if found := [record for record in remaining if version in (None, record.version)]:
            return found[-1]
        if version is None or not remaining:
            raise NotFoundError(
                f"There is no model named {str(name)[:80]!r}"
                + (": all of its versions were deleted." if versions else "."),
                remedy="Use one that is listed, or train it.",
                details={"model": str(name)[:80]},
            )
        is_known = any(record.version == version for record in versions)
        deleted = " any more: it was deleted" if is_known else ""
        raise NotFoundError(
            f"There is no version {version} of the model {name!r}{deleted}.",
            remedy=f"Use one of {', '.join(str(record.version) for record in remaining[-20:])}.",
            details={"model": name, "version": version},
        )

    def model_versions(self, name: str) -> tuple[card.ModelRecord, ...]:
        """Versions of a model from the first to the newest, without deleted ones.

        Raises
        ------
        NotFoundError
            If there are none.
        """
        self.model_record(name)
        return tuple(r for r in self._open_index().versions(name) if r.deleted is None)

    def models(self) -> tuple[card.ModelRecord, ...]:
        """All versions of all models by name and number, without deleted ones."""
        return tuple(record for record in self._open_index().models() if record.deleted is None)

    def models_with_id(self, model_id: str) -> tuple[card.ModelRecord, ...]:
        """All versions that are the model of that id, deleted ones too."""
        return tuple(self._open_index().models("WHERE id = ? ORDER BY name, version", model_id))

    def model_of_training(self, training: str) -> card.ModelRecord | None:
        """Find the version that a training has made, None if it has made none yet."""
        made = self._open_index().models("WHERE training = ?", training)
        return made[0] if made else None

    def model_path(self, name: str, version: int) -> Path:
        """HDF5 file of a version of a model.

        Raises
        ------
        NotFoundError
            If there is none.
        LostFileError
            If its file is gone.
        """
        return self._present(
            lambda: self._folder.path("models", self.model_record(name, version).reference),
            name,
            f"The file of the model {name}@{version}",
            "Train the model again, which makes a new version",
        )

    def kept_model(self, name: str, version: int) -> model_files.KeptModel:
        """Read the file of a version without interpreting the model in it.

        Raises
        ------
        NotFoundError
            If there is none.
        CorruptFileError
            If its file is damaged; LostFileError if it is gone.
        """
        path = self.model_path(name, version)
        return model_files.read_kept_model(path, {"model": name, "version": version})

    def model(self, name: str, version: int | None = None) -> Model:
        """Load a version of a model, the newest by default.

        Raises
        ------
        NotFoundError
            If there is none.
        CorruptFileError
            If its file is damaged or missing.
        """
        record = self.model_record(name, version)
        return model_files.model_from_hdf5(self._folder.path("models", record.reference))

    def delete_model(self, name: str, version: int) -> None:
        """Delete a version of a model; its number is not used again.

        Its classifications stay.

        Raises
        ------
        NotFoundError
            If there is none.
        StoreError
            If it could not be begun, and nothing is changed; or not be finished, which the
            next `open` does.
        """
        index = self._open_index()
        with self._changing(name):
            record = self.model_record(name, version)
            gone = deletion.begin_model_deletion(self._folder, record)
            # From here on it is deleted, whatever happens.
            index.put_model(gone)
            disk.remove_durably(self._folder.path("models", gone.reference))


class TemplateStore(sequences.SequenceStore):
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
        if not folders.is_id(template_id):
            raise StoreError(
                f"A template cannot be kept as {str(template_id)[:12]!r}: it is not a digest.",
                remedy="Use the template's own id.",
            )
        path = self._folder.path("templates", template_id)
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
        if (
            not folders.is_id(template_id)
            or not (path := self._folder.path("templates", template_id)).is_file()
        ):
            raise NotFoundError(
                f"There is no template {str(template_id)[:12]!r}.",
                remedy="Use the id returned when it was made, or make it.",
            )
        return path

    def templates(self) -> tuple[str, ...]:
        """Ids of all templates, sorted."""
        self._open_index()
        return tuple(self._folder.names("templates"))

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
            deletion.bury_and_remove(self.root, template_id, self.template_path(template_id))


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
        path = self._folder.path("norms", card.require_model_name(norm.name))
        with self._changing(deletion.digest_of_norm(norm.name)):
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

    def norm_path(self, name: str) -> Path:
        """HDF5 file of a norm.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        self._open_index()
        if not card.is_model_name(name) or not self._folder.path("norms", name).is_file():
            raise NotFoundError(
                f"There is no norm named {str(name)[:80]!r}.",
                remedy="Use one that is listed, or make it from your controls.",
                details={"norm": str(name)[:80]},
            )
        return self._folder.path("norms", name)

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
        return tuple(self._folder.names("norms"))

    def delete_norm(self, name: str) -> None:
        """Delete a norm; its name is free again.

        Raises
        ------
        NotFoundError
            If there is none.
        StoreError
            If its file cannot be removed.
        """
        digest = deletion.digest_of_norm(name)
        with self._changing(digest):
            deletion.bury_and_remove(self.root, digest, self.norm_path(name))
