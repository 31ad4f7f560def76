"""Pixels of a PNG (8 bits, RGB or RGBA), with nothing but Python's standard library."""
import struct
import zlib


class Picture:
    def __init__(self, data):
        assert data[:8] == b"\x89PNG\r\n\x1a\n", "expected a PNG"
        at, packed = 8, b""
        while at < len(data):
            (length,), kind = struct.unpack(">I", data[at:at + 4]), data[at + 4:at + 8]
            body = data[at + 8:at + 8 + length]
            if kind == b"IHDR":
                self.width, self.height, depth, colour = struct.unpack(">IIBB", body[:10])
                assert depth == 8 and colour in (2, 6), "expected 8 bits of RGB or RGBA"
                self.channels = 3 if colour == 2 else 4
            elif kind == b"IDAT":
                packed += body
            at += 12 + length
        self.rows = self._unfilter(zlib.decompress(packed))

    def _unfilter(self, raw):
        """Each row says how it was predicted from its neighbours: left, up, their mean, or Paeth's choice."""
        step, stride = self.channels, self.channels * self.width
        rows, above = [], bytes(stride)
        for y in range(self.height):
            start = y * (stride + 1)
            kind, row = raw[start], bytearray(raw[start + 1:start + 1 + stride])
            if kind == 2:
                row = bytearray((a + b) & 255 for a, b in zip(row, above))
            elif kind:
                for k in range(stride):
                    left = row[k - step] if k >= step else 0
                    corner = above[k - step] if k >= step else 0
                    up = above[k]
                    if kind == 1:
                        guess = left
                    elif kind == 3:
                        guess = (left + up) // 2
                    else:
                        by = left + up - corner
                        guess = min((abs(by - left), 0, left), (abs(by - up), 1, up), (abs(by - corner), 2, corner))[2]
                    row[k] = (row[k] + guess) & 255
            rows.append(bytes(row))
            above = rows[-1]
        return rows

    def at(self, x, y):
        return tuple(self.rows[y][self.channels * x:self.channels * x + 3])

    def colours(self):
        """How many different colours there are in every fourth pixel of every fourth row."""
        return len({self.at(x, y) for y in range(0, self.height, 4) for x in range(0, self.width, 4)})

    def differs(self, other):
        """True if more than 1 % of the pixels changed."""
        places = [(x, y) for y in range(0, self.height, 8) for x in range(0, self.width, 8)]
        return sum(self.at(*place) != other.at(*place) for place in places) > len(places) / 100

    def place_in(self, table, x, y):
        """Position of the pixel's colour in a table of RGB entries, 0 to 1; None if it is not in it."""
        pixel = self.at(x, y)
        distance = lambda k: sum(abs(pixel[c] - table[3 * k + c]) for c in range(3))
        entries = len(table) // 3
        best = min(range(entries), key=distance)
        return best / (entries - 1) if distance(best) <= 6 else None
