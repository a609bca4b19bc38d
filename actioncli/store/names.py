"""What people call things: labels, file names, notes, made safe to store and to print.

They end up in terminals, in JSON and perhaps in another program's command line, so nothing that
steers a terminal or reorders text (Unicode categories C*: control, format, surrogate, ...) may
pass, whether it was typed, read from a file name or imported.
"""

from __future__ import annotations

from actioncli.errors import UsageError

# Where negatives are kept; a label like any other, which can be shown, renamed and removed.
NEGATIVES = "negatives"

LONGEST_LABEL = 100
LONGEST_SOURCE = 255
LONGEST_NOTE = 500


# Letters to Unicode, and nothing on the screen: fillers of Hangul, the braille pattern of no dots.
_INVISIBLE = frozenset("\u115f\u1160\u2800\u3164\uffa0")


def _steers(character: str) -> bool:
    """Whether a character is more than a mark on the screen; blanks of any width are not."""
    if character in _INVISIBLE:
        return True
    if character.isprintable():
        return False
    import unicodedata

    return unicodedata.category(character) != "Zs"


def check_label(label: str) -> str:
    """The label as it is stored: stripped, and composed (NFC) so that equal looks are equal.

    Raises:
        UsageError: empty, longer than 100 characters, or with control or format characters.
    """
    if not isinstance(label, str):
        raise UsageError(f"A label must be text, not {type(label).__name__}.")
    text = label.strip()
    bad = sorted({character for character in text if _steers(character)})
    if bad:
        listed = ", ".join(f"U+{ord(character):04X}" for character in bad[:5])
        raise UsageError(
            f"The label {text[:LONGEST_LABEL]!a} holds characters that are not printable "
            f"({listed}); use letters, digits, spaces and signs."
        )
    if not text.isascii():
        import unicodedata

        text = unicodedata.normalize("NFC", text)
    if not text:
        raise UsageError("A label must not be empty; name the action, for example `wave`.")
    if len(text) > LONGEST_LABEL:
        raise UsageError(
            f"The label {text[:20]!r}... has {len(text)} characters; "
            f"at most {LONGEST_LABEL} are allowed."
        )
    return text


def plain_text(text: str, longest: int = LONGEST_NOTE) -> str:
    """Text on one line: what is not printable becomes a blank, what is too long is cut."""
    marks = (" " if _steers(character) else character for character in text)
    return " ".join("".join(marks).split())[:longest].rstrip()


def file_name(source: str) -> str:
    """The last part of a path: where a clip lay on someone's disk is no one else's business."""
    name = plain_text(source.replace("\\", "/").rstrip("/").rpartition("/")[2], LONGEST_SOURCE)
    return "" if name in {".", ".."} else name
