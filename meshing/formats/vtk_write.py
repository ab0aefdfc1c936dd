"""Files of VTK with the encoding of another."""

from __future__ import annotations

import re
from pathlib import Path

from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter


def encode_like(source: Path, writer: vtkXMLUnstructuredGridWriter) -> None:
    """Set a writer to text, binary or appended data, compression and sizes of numbers as in another file."""
    data = source.read_bytes()
    head = re.search(rb"<VTKFile[^>]*>", data)
    words = dict(re.findall(rb"(\w+)\s*=\s*\"([^\"]*)\"", head[0])) if head else {}
    compressor = {b"vtkZLibDataCompressor": 1, b"vtkLZ4DataCompressor": 2, b"vtkLZMADataCompressor": 3}
    writer.SetCompressorType(compressor.get(words.get(b"compressor", b""), 0))
    writer.SetHeaderType(64 if words.get(b"header_type") == b"UInt64" else 32)
    if words.get(b"byte_order") == b"BigEndian":
        writer.SetByteOrderToBigEndian()
    if b'format="appended"' in data:
        writer.SetDataModeToAppended()
        writer.SetEncodeAppendedData(b'encoding="raw"' not in data)
    elif b'format="binary"' in data:
        writer.SetDataModeToBinary()
    else:
        writer.SetDataModeToAscii()
    index = re.search(rb"<DataArray[^>]*Name=\"connectivity\"[^>]*>", data)
    writer.SetIdType(32 if index and b"Int32" in index[0] else 64)
