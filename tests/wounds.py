"""Damage to files, at random."""

import random
import re

ODD = [
    b"nan", b"inf", b"-inf", b"1e400", b"-1", b"0", b"1e308", b"1000000000000", b"9" * 20, b"-0.0",
    b"1e-320", b"x", b"", b"[", b"]", b'"', b"<", b"&", b"#", b"\0", b"1_0", b"0x10", b"\xff",
    b"\xd9\xa3", b"1" * 400, b"1/0", b"[[[[[[[[", b"{", b",", b"true", b"null",
]  # fmt: skip


def mutated(data: bytes, rng: random.Random) -> bytes:
    """The file with one to three wounds."""
    for _ in range(rng.randint(1, 3)):
        data = rng.choice(WOUNDS)(data, rng)
    return data


def flip_bytes(data, rng):
    out = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        if out:
            out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def cut(data, rng):
    return data[: rng.randrange(len(data) + 1)]


def cut_middle(data, rng):
    a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return data[:a] + data[b:]


def change_tokens(data, rng):
    parts = re.split(rb"(\s+|[\[\]<>\",])", data)
    i, j = (rng.randrange(len(parts)) for _ in range(2))
    match rng.randrange(5):
        case 0:
            parts[i] = b""
        case 1:
            parts[i] = parts[i] + b" " + parts[i]
        case 2:
            parts[i], parts[j] = parts[j], parts[i]
        case 3:
            parts[i] = rng.choice(ODD)
        case _:
            parts.insert(i, rng.choice(ODD))
    return b"".join(parts)


def change_number(data, rng):
    places = list(re.finditer(rb"-?\d+(\.\d*)?(e-?\d+)?", data))
    if not places:
        return data
    m = rng.choice(places)
    return data[: m.start()] + rng.choice(ODD) + data[m.end() :]


def shuffle_lines(data, rng):
    lines = data.splitlines(keepends=True)
    if len(lines) > 1:
        i = rng.randrange(len(lines) - 1)
        part = lines[i : i + rng.randint(2, 10)]
        rng.shuffle(part)
        lines[i : i + len(part)] = part
    return b"".join(lines)


def repeat(data, rng):
    a, b = sorted(rng.randrange(len(data) + 1) for _ in range(2))
    return data[:b] + data[a:b] + data[b:]


WOUNDS = [flip_bytes, cut, cut_middle, change_tokens, change_number, shuffle_lines, repeat]
WOUNDS += [change_tokens, change_number, change_number]
