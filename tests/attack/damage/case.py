"""A good input of a format, and the damage that applies to all formats."""
import dataclasses
import os
import typing
import zlib

import numpy as np

LINK, FIFO, FOLDER = "link", "fifo", "folder"


@dataclasses.dataclass
class Case:
    """An input: its files, and what is known about them."""
    name: str                 # the argument of the program: one of `files`, or a folder of them
    files: dict               # name -> bytes, or (LINK, target), (FIFO,), (FOLDER,)
    options: tuple = ()       # of the program's command line
    target: str = ""          # the file that is damaged; `name` if empty
    fields: tuple = ()        # (offset, NumPy type) of the numbers in the target's header
    texts: tuple = ()         # (from, to) of the text in the target
    exact: bool = False       # whether the target's last byte is needed, so that no truncated file is valid
    read: typing.Callable = None  # path -> the values [z, y, x] as an independent reader gives them
    values: object = None     # what was written: a truncated file may give this or an error
    closing: typing.Callable = None  # target's bytes -> bytes with corrected lengths and checksums
    apart: bool = False       # whether the reader is a C library, which may crash
    close: bool = False       # values may differ by rounding
    cut: bool = False         # whether the only damage is that the target was truncated

    def __post_init__(self):
        self.target = self.target or self.name

    @property
    def data(self):
        return self.files[self.target]

    def with_data(self, data, **more):
        return dataclasses.replace(self, files={**self.files, self.target: bytes(data)}, **more)

    def with_files(self, more, **changes):
        return dataclasses.replace(self, files={**self.files, **more}, **changes)

    def write(self, folder):
        for name, data in self.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            if isinstance(data, tuple):
                if data[0] == LINK:
                    path.symlink_to(data[1])
                elif data[0] == FIFO:
                    os.mkfifo(path)
                else:
                    path.mkdir()
            else:
                path.write_bytes(data)


# Places that a header, a link or an archive must not make the program access; relative to the try's folder.
ELSEWHERE = ("/etc/passwd", "../../outside/secret.raw", "/dev/zero", "/dev/full", "/dev/stdin", "/dev/tty", "pipe",
             "folder", "loop", "/proc/self/mem", "/proc/self/environ", "/proc/kmsg", ".", "", "a\0b", "x" * 300,
             "x/" * 3000, "https://127.0.0.1:9/a", "file:///etc/passwd", "%n%s%d", "no such file", "-", "/")


def astray(case, one):
    """One of ELSEWHERE; the FIFO, folder and loop among them are next to the input."""
    here = os.path.dirname(case.target)
    more = {os.path.join(here, "pipe"): (FIFO,), os.path.join(here, "folder"): (FOLDER,),
            os.path.join(here, "loop"): (LINK, "loop")}
    place = one.pick(*ELSEWHERE, str(one.folder / "outside/secret.raw"), os.path.basename(case.target))
    return case.with_files(more), place


def whole_numbers(kind, now, one):
    """A number of this integer type that may cause harm."""
    limits = np.iinfo(kind)
    choice = one.pick(0, 1, 2, 3, -1, -2, limits.max, limits.min, limits.max - 1, limits.max // 2, limits.max // 8,
                      1 << 16, 1 << 20, (1 << 20) + 1, 1 << 31, 1 << 32, (1 << 63) - 1, now + 1, now - 1, 2 * now, -now, 255 * now,
                      int.from_bytes(one.random.bytes(kind.itemsize), "little"),
                      int.from_bytes(int(now).to_bytes(16, "little", signed=True)[:kind.itemsize][::-1], "little"))
    return int(choice) & ((1 << 8 * kind.itemsize) - 1)


def field(case, one):
    data = bytearray(case.data)
    for _ in range(one.pick(1, 1, 1, 2, 3)):
        at, kind = case.fields[int(one.random.integers(len(case.fields)))]
        kind = np.dtype(kind)
        if at + kind.itemsize > len(data):
            continue
        if kind.kind == "f":
            now = float(np.frombuffer(data, kind, 1, at)[0])
            value = one.pick(0.0, -0.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e38, 1e-38, 1e30, 1e-30, -1.0, -now, now * 1e5,
                             float(one.random.normal()))
            with np.errstate(all="ignore"):
                data[at:at + kind.itemsize] = np.array(value).astype(kind).tobytes()
        else:
            now = int(np.frombuffer(data, kind, 1, at)[0])
            number = whole_numbers(kind, now, one)
            data[at:at + kind.itemsize] = number.to_bytes(kind.itemsize, "big" if kind.byteorder == ">" else "little")
    return case.with_data(data)


def flips(case, one):
    data = bytearray(case.data)
    reach = len(data) if one.chance(0.4) else min(len(data), one.pick(16, 64, 400, 1100))
    for _ in range(one.pick(1, 1, 2, 4, 16)):
        at = int(one.random.integers(reach))
        data[at] = data[at] ^ 1 << int(one.random.integers(8)) if one.chance(0.5) else int(one.random.integers(256))
    return case.with_data(data)


def cut(case, one):
    data = case.data
    keep = one.pick(int(one.random.integers(len(data))), len(data) - 1, len(data) - int(one.random.integers(1, min(len(data), 40) + 1)),
                    int(one.random.integers(min(len(data), 700))), len(data) // 2)
    return case.with_data(data[:max(0, keep)], cut=True)


def blocks(case, one):
    """Swaps, duplicates, removes, inserts or clears blocks."""
    data = bytearray(case.data)
    size = int(one.pick(1, 2, 4, 8, 16, 64, 512))
    a, b = (int(at) for at in one.random.integers(0, max(1, len(data) - size), 2))
    what = int(one.random.integers(6))
    if what == 0:
        data[a:a + size], data[b:b + size] = data[b:b + size], data[a:a + size]
    elif what == 1:
        data[a:a] = data[b:b + size]
    elif what == 2:
        del data[a:a + size]
    elif what == 3:
        data[a:a] = one.random.bytes(size)
    elif what == 4:
        data[a:a + size] = bytes([one.pick(0, 255)]) * len(data[a:a + size])
    else:
        data += one.random.bytes(size)
    return case.with_data(data)


TOKENS = (b"1e999", b"-1e999", b"nan", b"inf", b"-inf", b"0", b"-1", b"-0", b"99999999999999999999", b"1e-999", b"0x10", b"1e5", b"",
          b"18446744073709551615", b"18446744073709551616", b"9223372036854775807", b"9223372036854775808", b"-9223372036854775808",
          b"2147483647", b"2147483648", b"4294967295", b"4294967296", b"1048576", b"1048577", b"65536", b"+3", b"3.", b".", b"3.5",
          b"\xd9\xa3", b"1,5", b"3;4", b"1_0", b"07", b"1" * 400, b"9" * 5000, b"0." + b"0" * 400 + b"1", b"1e+308", b"-", b"e", b"%s%n")


def is_number(byte):
    return byte in b"0123456789.+-"


def text(case, one):
    """Changes numbers, words or lines of a text."""
    data = bytearray(case.data)
    start, end = case.texts[int(one.random.integers(len(case.texts)))]
    end = min(end, len(data))
    part = bytes(data[start:end])
    part = changed_text(part, one)
    data[start:end] = part
    data = bytes(data)
    if case.closing and one.chance(0.8):
        data = case.closing(data)
    return case.with_data(data, fields=(), texts=())


def numbers_in(part):
    places, at = [], 0
    while at < len(part):
        begin = at
        while at < len(part) and is_number(part[at]):
            at += 1
        if at > begin and any(48 <= byte <= 57 for byte in part[begin:at]):
            places.append((begin, at))
        at += at == begin
    return places


def changed_text(part, one):
    lines = part.split(b"\n")
    what = int(one.random.integers(13))
    i, j = (int(k) for k in one.random.integers(0, len(lines), 2))
    if what <= 4:
        places = numbers_in(part)
        if places:
            for _ in range(one.pick(1, 1, 2)):
                begin, stop = places[int(one.random.integers(len(places)))]
                return part[:begin] + one.pick(*TOKENS) + part[stop:]
    if what == 5:
        lines[i:i] = [lines[j]] * one.pick(1, 1, 2, 3000)
    elif what == 6:
        del lines[i]
    elif what == 7:
        lines[i], lines[j] = lines[j], lines[i]
    elif what == 8:
        lines[i] += one.pick(b"A", b" ", b"1 ", b"(", b"\t", b"\"", b"<a>", b"{") * one.pick(1, 3, 1000, 1 << 20)
    elif what == 9:
        at = int(one.random.integers(len(part) + 1))
        return part[:at] + one.pick(b"\0", b"\r", b"\n", b"\n\n", b"\xff\xfe", b"\x1a", b"\x1b[2J", b" ", b"#", b"\"", b"'", b"\\") + part[at:]
    elif what == 10:
        words = lines[i].split(b" ")
        k, m = (int(n) for n in one.random.integers(0, len(words), 2))
        words[k], words[m] = words[m], one.pick(words[k], words[k].upper(), words[k].lower(), b"", words[k] * 2)
        lines[i] = b" ".join(words)
    elif what == 11:
        at = int(one.random.integers(len(part) or 1))
        return part[:at] + bytes([int(one.random.integers(256))]) + part[at + 1:]
    else:
        at = int(one.random.integers(len(part) or 1))
        return part[:at] + part[at + one.pick(1, 2, 8):]
    return b"\n".join(lines)


def damaged(case, one, specials=()):
    """The case with one or several kinds of damage; specials: those of the format, functions of a case and a Try."""
    ways = [flips, flips, cut, cut, blocks]
    if case.fields:
        ways += [field] * 4
    if case.texts:
        ways += [text] * 4
    ways += list(specials) * max(1, 5 // max(1, len(specials)))
    way = one.pick(*ways)
    case = way(case, one)
    if one.chance(0.15) and isinstance(case.data, bytes) and len(case.data) > 4:
        case = one.pick(flips, blocks)(case, one)
        case.cut = False
    return case


def bomb(size):
    """`size` zeros (whole MiB) as a raw deflate stream."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    piece = packer.compress(bytes(1 << 20)) + packer.flush(zlib.Z_FULL_FLUSH)  # depends on nothing before it
    return piece * (size >> 20) + packer.flush()
