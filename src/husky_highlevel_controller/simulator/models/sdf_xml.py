"""XML of SDF files: read as Gazebo's parser TinyXML reads it, but harmful XML is refused.

In: bytes or text. Out: elements with their line numbers.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from pathlib import Path
from typing import Any, Match, Optional, Union
from xml.etree import ElementTree

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser

from husky_highlevel_controller.datatypes import HuskyError

# Parts of a file that Gazebo's XML parser (TinyXML) accepts, but that Python's parser may reject: comments,
# <?...> and a single &. A CDATA section is matched as a whole, so that nothing inside it is replaced. Each
# alternative of the pattern reads a byte only once, so the time grows only with the size of the file.
_LOOSE = re.compile(
    rb"<!\[CDATA\[.*?(?:\]\]>|\Z)|<!--.*?(?:-->|\Z)|<\?(?!xml\s)[^>]*(?:>|\Z)"
    rb"|&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[\da-fA-F]+);)",
    re.DOTALL,
)
_DECLARATION = re.compile(rb"(\s+)(<\?xml\s[^>]*\?>)")  # space, and the declaration behind it
# declaration of an encoding that is not UTF-8
_OTHER_ENCODING = re.compile(rb"<\?xml\s[^>]*?encoding\s*=\s*[\"'](?!utf-?8[\"'])", re.IGNORECASE)
_UTF_16 = re.compile(rb"\xff\xfe|\xfe\xff|<\0|\0<")  # byte order mark, or `<` in two bytes


class WorldError(HuskyError):
    """A world file cannot be read; the text names file, line, element and value."""


class _Element(ElementTree.Element):
    line = 0


class _LineBuilder(ElementTree.TreeBuilder):
    """Builder of elements with a line number."""

    expat: Any = None  # parser, which has the number of the present line

    def start(self, tag: Any, attrs: Any) -> Any:
        """Make an element with the number of the line that the parser reads."""
        element: Any = super().start(tag, attrs)
        element.line = self.expat.CurrentLineNumber
        return element


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file. Raises WorldError if the file cannot be read."""
    try:
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: no file can have this name
        reason = getattr(error, "strerror", None) or error
        raise WorldError(f"{path}: cannot be read ({reason}); check the path") from error


def parse_xml(data: Union[str, bytes], source: str) -> ElementTree.Element:
    """Parse XML into its root element, with line numbers. Raises WorldError on invalid or unsafe XML."""
    builder = _LineBuilder(element_factory=_Element)
    try:
        content = data.encode() if isinstance(data, str) else data
        # a str was encoded as UTF-8 above, whatever its declaration says; None lets the parser find the
        # encoding of bytes
        encoding = "utf-8" if isinstance(data, str) else None
        # `_strict` replaces what TinyXML reads and Python's parser rejects. UTF-16 stays as it is, because
        # most of its characters contain a NUL byte, at which `_strict` would stop.
        if not _UTF_16.match(content):
            content = _strict(content)
            encoding = encoding or _encoding_of(content)
        parser = DefusedXMLParser(target=builder, encoding=encoding)
        builder.expat = parser.parser  # the builder asks it for the line of each element
        parser.feed(content)
        root: ElementTree.Element = parser.close()
    except DefusedXmlException as error:
        raise WorldError(
            f"{source}: XML entities are refused, because they can be harmful: {error}"
        ) from error
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise WorldError(f"{source}: is not valid XML: {error}") from error
    return root


def _strict(data: bytes) -> bytes:
    """Return XML that Python's parser accepts, from XML that TinyXML accepts; lines keep their numbers.

    It is the same XML without its comments and processing instructions, with &amp; for a single &, and up to
    the first NUL.
    """
    text = data[len(BOM_UTF8) :] if data.startswith(BOM_UTF8) else data
    text, _, _ = text.partition(b"\0")  # TinyXML ends at a NUL byte
    text = _LOOSE.sub(_strict_part, text)
    # space before the declaration <?xml ...?> moves behind it, so that the lines keep their numbers
    return _DECLARATION.sub(rb"\2\1", text, count=1) if _DECLARATION.match(text) else text


def _strict_part(part: Match[bytes]) -> bytes:
    """Return the replacement for a part that _LOOSE matches: a comment, <?...>, CDATA section, or single &.

    The replacement has the same number of line breaks.
    """
    text = part.group()
    is_comment = text.startswith(b"<!--") and text.endswith(b"-->")
    is_instruction = text.startswith(b"<?") and text.endswith(b">")
    if is_comment or is_instruction:
        return b"\n" * text.count(b"\n")
    # a CDATA section, and a comment or <?...> without an end, stay as they are
    return b"&amp;" if text == b"&" else text


def _encoding_of(data: bytes) -> Optional[str]:
    """Return the encoding of XML; None if the parser can find it by itself.

    XML that is not UTF-8 and declares no other encoding is read as Latin-1. The parser alone would reject it.
    """
    try:
        data.decode()
        return None
    except UnicodeDecodeError:
        return None if _OTHER_ENCODING.match(data) else "iso-8859-1"
