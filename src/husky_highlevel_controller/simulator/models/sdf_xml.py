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
# <?...> except <?xml ...?>, and an & that begins no entity such as &amp;. The pattern also matches a CDATA
# section, as a whole, so that nothing inside it is replaced. Each alternative of the pattern reads a byte
# only once, so the time grows only in proportion to the size of the file.
_LOOSE = re.compile(
    rb"<!\[CDATA\[.*?(?:\]\]>|\Z)|<!--.*?(?:-->|\Z)|<\?(?!xml\s)[^>]*(?:>|\Z)"
    rb"|&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[\da-fA-F]+);)",
    re.DOTALL,
)
_DECLARATION = re.compile(rb"(\s+)(<\?xml\s[^>]*\?>)")  # space, and the declaration behind it
# declaration of an encoding that is not UTF-8
_OTHER_ENCODING = re.compile(rb"<\?xml\s[^>]*?encoding\s*=\s*[\"'](?!utf-?8[\"'])", re.IGNORECASE)
_UTF_16 = re.compile(rb"\xff\xfe|\xfe\xff|<\0|\0<")  # byte order mark, or `<` beside a NUL byte


class WorldError(HuskyError):
    """A world file cannot be read; the text names file, line, element and value."""


class _Element(ElementTree.Element):
    """XML element with the number of its line in the file, for messages."""

    line = 0


class _LineBuilder(ElementTree.TreeBuilder):
    """Builder of elements with a line number."""

    expat: Any = None  # parser, which knows the line that it reads now

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
        if isinstance(data, str):
            # a text becomes UTF-8 here, whatever encoding its declaration names
            content, encoding = data.encode(), "utf-8"
        else:
            content, encoding = data, None  # None lets the parser find the encoding
        # `_strict` replaces what TinyXML reads and Python's parser rejects. UTF-16 stays as it is, because
        # most of its characters contain a NUL byte, at which `_strict` would stop.
        if not _UTF_16.match(content):
            content = _strict(content)
            encoding = encoding or _encoding_of(content)
        parser = DefusedXMLParser(target=builder, encoding=encoding)
        builder.expat = parser.parser  # the builder asks this parser for the line of each element
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

    The result has no byte order mark, no comments and no processing instructions. It has &amp; for a single
    &, and ends at the first NUL byte. The declaration <?xml ...?> is at its beginning.
    """
    text = data[len(BOM_UTF8) :] if data.startswith(BOM_UTF8) else data
    text, _, _ = text.partition(b"\0")  # TinyXML ends at a NUL byte
    text = _LOOSE.sub(_strict_part, text)
    # space before the declaration is moved behind it, and not removed, so that the lines keep their numbers
    if _DECLARATION.match(text):
        text = _DECLARATION.sub(rb"\2\1", text, count=1)
    return text


def _strict_part(part: Match[bytes]) -> bytes:
    """Return the replacement for a part of the text that _LOOSE matches: a single &, or one of three blocks.

    The blocks are a comment, a <?...> and a CDATA section. Comments and <?...> are removed, because Python's
    parser rejects some that TinyXML skips, such as a comment with -- in its text. The replacement has the
    same number of line breaks, so that lines keep their numbers.
    """
    text = part.group()
    if text == b"&":
        return b"&amp;"
    is_comment = text.startswith(b"<!--") and text.endswith(b"-->")
    is_instruction = text.startswith(b"<?") and text.endswith(b">")
    if is_comment or is_instruction:
        return b"\n" * text.count(b"\n")
    return text  # a CDATA section; or a comment or <?...> that does not end, which the parser will reject


def _encoding_of(data: bytes) -> Optional[str]:
    """Return the encoding that the parser must be told; None if the parser can find it by itself.

    XML that is not UTF-8, although it declares UTF-8 or nothing, is read as Latin-1. The parser alone would
    reject such XML.
    """
    try:
        data.decode()
        return None  # UTF-8
    except UnicodeDecodeError:
        if _OTHER_ENCODING.match(data):
            return None  # the parser reads the encoding from the declaration
        return "iso-8859-1"
