"""Writer of ULog files for the tests; shares no code with the reader or with pyulog."""

import struct

CODES = {"uint64_t": "Q", "uint32_t": "I", "uint16_t": "H", "uint8_t": "B", "int32_t": "i", "float": "f", "double": "d",
         "bool": "B"}  # fmt: skip


def record(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def header(*, magic: bytes = b"ULog\x01\x12\x35\x01") -> bytes:
    return magic + struct.pack("<Q", 1_000_000) + record("B", bytes(8 + 8 + 24))


def fields_of(definition: str) -> list[tuple[str, int, str]]:
    fields = []
    for entry in definition.split(";"):
        kind, _, name = entry.strip().partition(" ")
        kind, _, number = kind.partition("[")
        fields.append((kind, int(number.rstrip("]") or 1), name))
    return fields


def ulog(topics: dict[str, str], messages: list[tuple[str, dict]], instances: dict[str, tuple[str, int]]) -> bytes:
    """A log.

    ``topics`` names formats (``"uint64_t timestamp;float[3] gyro_rad"``), ``instances`` the streams as (topic, multi
    id), ``messages`` pairs of stream and values.
    """
    parts = [header()]
    parts += [record("F", f"{name}:{definition};".encode()) for name, definition in topics.items()]
    numbers = {}
    for number, (stream, (topic, multi)) in enumerate(instances.items()):
        numbers[stream] = number
        parts.append(record("A", struct.pack("<BH", multi, number) + topic.encode()))
    for stream, values in messages:
        body = struct.pack("<H", numbers[stream])
        for kind, number, name in fields_of(topics[instances[stream][0]]):
            value = values.get(name, 0)
            for item in value if number > 1 else [value]:
                body += struct.pack("<" + CODES[kind], item)
        parts.append(record("D", body))
    return b"".join(parts)
