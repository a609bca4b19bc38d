"""Fuzz one reader: python tests/fuzz/harness.py READER [folder...] [-libfuzzer_option=value...]

New inputs go to the first folder, as libFuzzer does it; the committed corpus is always read.
"""

import gc
import os
import sys
import tempfile
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["actioncli", "json.decoder", "zipfile", "csv"]):
    sys.path.insert(0, str(Path(__file__).parent))
    from readers import CORPUS, READERS, mutator

    # Otherwise imported at their first use, which would leave them without instruments.
    from actioncli.clips.formats import bvh, c3d, csv_file, json_file, npy, npz, ntu, trc  # noqa: F401
    from actioncli.errors import ActionCliError

# Longer files only repeat what shorter ones say, and the small ones are read far more often.
_LONGEST = 16_384
# A reader that has a process of its own may take five seconds until that is ended.
_OPTIONS = ("-timeout=30", "-rss_limit_mb=1024", f"-max_len={_LONGEST}", "-print_final_stats=1")


def main(words: list[str]) -> None:
    """Run until libFuzzer's options say that it is enough, or something is found."""
    name, *rest = words
    reader = READERS[name]
    warnings.simplefilter("error")
    shared_memory = Path("/dev/shm")
    base = shared_memory if os.access(shared_memory, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=base) as folder:
        file = Path(folder) / f"a{reader.suffix}"

        def one(data: bytes) -> None:
            file.write_bytes(reader.whole(data))
            try:
                reader.read(file)
            except ActionCliError as error:
                if not str(error):
                    raise AssertionError("an error without a message") from error

        def mutate(data: bytes, max_size: int) -> bytes:
            # Looked up late: atheris exchanges the function when it starts.
            changed: bytes = atheris.Mutate(data, max_size)
            return changed

        own = {} if reader.pack is None else {"custom_mutator": mutator(reader, mutate)}
        given = [word for word in rest if not word.startswith("-")]
        options = [word for word in rest if word.startswith("-")]
        arguments = [sys.argv[0], *_OPTIONS, *options, *given, str(CORPUS / name)]
        atheris.Setup(arguments, one, **own)
        gc.collect()
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1:])
