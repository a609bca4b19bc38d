"""Where the files that ship with the package stand: trained weights, pose networks, model card."""

from pathlib import Path

from actioncli.errors import WeightsError

_PACKAGE = Path(__file__).resolve().parent


def weights_folder() -> Path:
    """The folder of the shipped weights.

    Inside an installed wheel that is `actioncli/weights`; in a checkout, and so in an editable
    install, `weights` stands beside the package.
    """
    installed = _PACKAGE / "weights"
    return installed if installed.is_dir() else _PACKAGE.parent / "weights"


def weights_file(name: str) -> Path:
    """The path of one shipped file, such as `trx_os.safetensors`.

    Raises:
        WeightsError: the file did not come with this installation.
    """
    path = weights_folder() / name
    if not path.is_file():
        raise WeightsError(
            f"{path} is missing: this installation of actioncli is incomplete. Install it again."
        )
    return path
