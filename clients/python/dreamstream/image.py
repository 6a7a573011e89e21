"""Images of an observation as numpy arrays: raw rows, or 8-bit RGB PNG without interlacing."""

from __future__ import annotations

import struct
import zlib

import numpy as np

MAX_SIDE_PX = 8192
_SIGNATURE = b"\x89PNG\r\n\x1a\n"


class ImageError(ValueError):
    """Says what is wrong with an image."""


def from_raw(data: bytes, *, width_px: int, height_px: int) -> np.ndarray:
    """Returns (height, width, 3) of raw rows."""
    _check_sides(width_px=width_px, height_px=height_px)
    if len(data) != width_px * height_px * 3:
        raise ImageError(f'image field "data" holds {len(data)} bytes, {width_px * height_px * 3} expected')
    return np.frombuffer(data, dtype=np.uint8).reshape(height_px, width_px, 3)


def from_png(data: bytes, *, width_px: int, height_px: int) -> np.ndarray:
    """Returns (height, width, 3) of a PNG whose size is known beforehand."""
    _check_sides(width_px=width_px, height_px=height_px)
    if data[:8] != _SIGNATURE:
        raise ImageError('image field "data" is not a PNG')
    at, packed = 8, bytearray()
    while at + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        body = data[at + 8 : at + 8 + length]
        if len(body) != length:
            raise ImageError('image field "data" ends inside a PNG chunk')
        if kind == b"IHDR":
            _check_header(body, width_px=width_px, height_px=height_px)
        elif kind == b"IDAT":
            packed += body
        elif kind == b"IEND":
            break
        at += 12 + length
    expected = height_px * (1 + 3 * width_px)
    try:
        unpacked = zlib.decompressobj().decompress(bytes(packed), expected + 1)
    except zlib.error as error:
        raise ImageError(f'image field "data" cannot be unpacked: {error}') from error
    if len(unpacked) != expected:
        raise ImageError(f'image field "data" unpacks to {len(unpacked)} bytes, {expected} expected')
    lines = np.frombuffer(unpacked, dtype=np.uint8).reshape(height_px, 1 + 3 * width_px)
    return _unfilter(lines[:, 0], lines[:, 1:].reshape(height_px, width_px, 3))


def _check_sides(*, width_px: int, height_px: int) -> None:
    if not (1 <= width_px <= MAX_SIDE_PX and 1 <= height_px <= MAX_SIDE_PX):
        raise ImageError(f"image of {width_px} x {height_px} px: each side must be 1 to {MAX_SIDE_PX}")


def _check_header(body: bytes, *, width_px: int, height_px: int) -> None:
    found = struct.unpack(">IIBBBBB", body) if len(body) == 13 else ()
    if found[:2] != (width_px, height_px):
        raise ImageError(f"image says {width_px} x {height_px} px, its PNG holds {found[:2]}")
    if found[2:4] != (8, 2) or found[6] != 0:
        raise ImageError(f"image PNG has depth and colour type {found[2:4]}, 8-bit RGB without interlacing expected")


def _unfilter(filters: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Undoes the PNG filters, arithmetic modulo 256."""
    image = np.empty_like(rows)
    above = np.zeros_like(rows[0])
    for y, (kind, row) in enumerate(zip(filters, rows)):
        if kind == 0:
            image[y] = row
        elif kind == 1:
            image[y] = np.add.accumulate(row, axis=0, dtype=np.uint8)
        elif kind == 2:
            image[y] = row + above
        elif kind in (3, 4):
            image[y] = _predicted(int(kind), row=row, above=above)
        else:
            raise ImageError(f"image PNG has filter {kind} in row {y}")
        above = image[y]
    return image


def _predicted(kind: int, *, row: np.ndarray, above: np.ndarray) -> np.ndarray:
    out = np.zeros((len(row) + 1, 3), dtype=np.int32)
    up = np.zeros((len(row) + 1, 3), dtype=np.int32)
    up[1:] = above
    for x in range(len(row)):
        a, b, c = out[x], up[x + 1], up[x]
        if kind == 3:
            guess = (a + b) // 2
        else:
            p = a + b - c
            pa, pb, pc = abs(p - a), abs(p - b), abs(p - c)
            guess = np.where((pa <= pb) & (pa <= pc), a, np.where(pb <= pc, b, c))
        out[x + 1] = (row[x] + guess) & 0xFF
    return out[1:].astype(np.uint8)
