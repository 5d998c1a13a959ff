"""Reads XML without the features that could make it dangerous: DOCTYPE and entities."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.parsers import expat

from zmp_sqp.errors import MachineError

__all__ = ["parse_xml"]


def parse_xml(content: bytes, root: str, format_name: str) -> ET.Element:
    """Root element of a file.

    Args:
        content: Content of the file.
        root: Tag that the root element must have.
        format_name: Name of the file format in error messages, with its article.

    Raises:
        MachineError: Empty, not well-formed, another root element, or a DOCTYPE or ENTITY
            declaration; the message names the line, but not the file.
    """
    if not content.strip():
        raise MachineError("the file is empty")
    guard = expat.ParserCreate()

    def refuse(*_: object) -> None:
        raise MachineError(
            f"line {guard.CurrentLineNumber}: DOCTYPE and ENTITY declarations are refused"
        )

    guard.StartDoctypeDeclHandler = guard.EntityDeclHandler = refuse
    try:
        guard.Parse(content, True)
        element = ET.fromstring(content)
    except (expat.ExpatError, ET.ParseError) as fault:
        # the parser's text names line and column
        raise MachineError(f"not well-formed XML: {fault}") from None
    except (LookupError, ValueError) as fault:
        raise MachineError(f"not XML that can be read: {fault}") from None
    if element.tag.split("}")[-1] != root:
        raise MachineError(f"not {format_name}: its root element is <{element.tag}>, not <{root}>")
    return element
