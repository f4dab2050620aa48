"""The segments before a JPEG's picture data: read, left out, inserted. Picture data is not touched.

A camera's own EXIF and XMP are found here, so that they can be completed instead of doubled.
"""

from __future__ import annotations

from dataclasses import dataclass

EXIF_HEADER = b"Exif\0\0"
XMP_HEADER = b"http://ns.adobe.com/xap/1.0/\0"
_START, _APP0, _APP1 = b"\xff\xd8", 0xE0, 0xE1
_LONGEST = 65533


class NotAJpeg(ValueError):
    """What the camera delivered is not a JPEG picture."""


@dataclass(frozen=True, slots=True)
class Jpeg:
    """A JPEG file taken apart."""

    head: bytes
    """The JFIF segment, where there is one: readers expect it first."""
    exif: bytes
    """Content of the EXIF segment, its header included; empty where there is none."""
    xmp: bytes
    """The XMP packet without its header."""
    rest: bytes
    """Everything else, from the first segment that is none of these on."""

    def joined(self, exif: bytes, xmp: bytes) -> bytes:
        """Return the file with other EXIF (header included) and XMP (a packet)."""
        parts = [_START, self.head, _segment(exif)]
        # What does not fit into one segment is left out: EXIF says the same and more is beside it.
        if len(XMP_HEADER) + len(xmp) <= _LONGEST:
            parts.append(_segment(XMP_HEADER + xmp))
        return b"".join([*parts, self.rest])


def take_apart(data: bytes) -> Jpeg:
    """Take a JPEG file apart. Raises `NotAJpeg`."""
    if not data.startswith(_START):
        raise NotAJpeg("the file does not begin as a JPEG")
    head = exif = xmp = b""
    others: list[bytes] = []
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and _APP0 <= data[at + 1] <= 0xEF:
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        content = data[at + 4 : end]
        if data[at + 1] == _APP0 and not head and at == 2:
            head = data[at:end]
        elif data[at + 1] == _APP1 and content.startswith(EXIF_HEADER) and not exif:
            exif = content
        elif data[at + 1] == _APP1 and content.startswith(XMP_HEADER) and not xmp:
            xmp = content[len(XMP_HEADER) :]
        else:
            others.append(data[at:end])
        at = end
    return Jpeg(head, exif, xmp, b"".join([*others, data[at:]]))


def picture_data(data: bytes) -> bytes:
    """Return what follows the application segments: tables and picture. Raises `NotAJpeg`."""
    rest = take_apart(data).rest
    at = 0
    while at + 4 <= len(rest) and rest[at] == 0xFF and _APP0 <= rest[at + 1] <= 0xEF:
        at += 2 + int.from_bytes(rest[at + 2 : at + 4], "big")
    return rest[at:]


def _segment(content: bytes) -> bytes:
    return b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content
