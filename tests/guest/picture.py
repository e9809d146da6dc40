"""Reads PNG pictures and says how far two of them are apart; nothing but Python's own library.

`python3 picture.py ONE.png OTHER.png` prints the figures.
"""

import struct
import sys
import zlib

# Bytes per pixel of the colour types read here, all with 8 bits per channel: RGB and RGBA.
CHANNELS = {2: 3, 6: 4}


class Picture:
    """Rows of RGB bytes, top row first."""

    def __init__(self, width_px, height_px, rows):
        self.width_px, self.height_px, self.rows = width_px, height_px, rows

    def colours(self):
        """How many different colours it has: one where a screen is blank."""
        return len({row[x : x + 3] for row in self.rows for x in range(0, len(row), 3)})


def unfilter(kind, line, above, step):
    """Undoes one of the PNG filters (ISO/IEC 15948, 9.2) on `line` in place."""
    if kind == 1:
        for i in range(step, len(line)):
            line[i] = (line[i] + line[i - step]) & 255
    elif kind == 2:
        line[:] = bytes((a + b) & 255 for a, b in zip(line, above))
    elif kind == 3:
        for i in range(len(line)):
            left = line[i - step] if i >= step else 0
            line[i] = (line[i] + (left + above[i]) // 2) & 255
    elif kind == 4:
        for i in range(len(line)):
            a, b, c = (line[i - step], above[i], above[i - step]) if i >= step else (0, above[i], 0)
            near_a, near_b, near_c = abs(b - c), abs(a - c), abs(a + b - 2 * c)
            best = a if near_a <= near_b and near_a <= near_c else b if near_b <= near_c else c
            line[i] = (line[i] + best) & 255
    elif kind != 0:
        raise ValueError(f"unknown PNG filter {kind}")


def read(path):
    """The picture in a PNG file; alpha is left out. ValueError where it is none, or of a kind not read here."""
    with open(path, "rb") as file:
        data = file.read()
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        raise ValueError(f"{path} is not a PNG file")
    header, packed, at = None, [], 8
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        body = data[at + 8 : at + 8 + length]
        if zlib.crc32(kind + body) != struct.unpack_from(">I", data, at + 8 + length)[0]:
            raise ValueError(f"{path} is damaged: checksum of chunk {kind.decode()}")
        if kind == b"IHDR":
            header = struct.unpack(">IIBBBBB", body)
        elif kind == b"IDAT":
            packed.append(body)
        at += 12 + length
    if header is None or header[2] != 8 or header[3] not in CHANNELS or header[6] != 0:
        raise ValueError(f"{path}: only plain 8-bit RGB and RGBA are read, not {header}")
    width_px, height_px, step = header[0], header[1], CHANNELS[header[3]]
    pixels, size, rows = zlib.decompress(b"".join(packed)), width_px * step + 1, []
    if len(pixels) != size * height_px:
        raise ValueError(f"{path} is cut short: {len(pixels)} bytes of pixels")
    above = bytearray(size - 1)
    for start in range(0, len(pixels), size):
        line = bytearray(pixels[start + 1 : start + size])
        unfilter(pixels[start], line, above, step)
        above = line
        if step == 4:
            line = bytearray(byte for i, byte in enumerate(line) if i % 4 != 3)
        rows.append(bytes(line))
    return Picture(width_px, height_px, rows)


class Difference:
    """`levels_max`: the largest difference of any channel; `beyond`: the part of the pixels beyond `tolerance`."""

    def __init__(self, one, other, tolerance):
        if (one.width_px, one.height_px) != (other.width_px, other.height_px):
            sizes = [f"{picture.width_px}x{picture.height_px}" for picture in (one, other)]
            raise ValueError(f"the pictures have different sizes: {sizes[0]} and {sizes[1]}")
        self.levels_max, beyond = 0, 0
        for left, right in zip(one.rows, other.rows):
            if left == right:
                continue
            apart = [abs(a - b) for a, b in zip(left, right)]
            self.levels_max = max(self.levels_max, max(apart))
            beyond += sum(max(apart[x : x + 3]) > tolerance for x in range(0, len(apart), 3))
        self.beyond = beyond / (one.width_px * one.height_px)


if __name__ == "__main__":
    found = Difference(read(sys.argv[1]), read(sys.argv[2]), tolerance=2)
    print(f"largest difference {found.levels_max} of 255; {100 * found.beyond:.3f} % of the pixels differ by more than 2")
