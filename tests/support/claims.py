"""Headers that claim gigabytes, read in this process alone: prints how much address space each asked for, as JSON.

Run by ``test_claims.py``. What counts is the address space (``VmPeak``), so an array that is allocated and never
touched counts, too; the limit only keeps a reader that believes a claim from taking the machine with it.
"""

import bz2
import gzip
import io
import json
import re
import resource
import struct
import sys
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import samples

from schuler.exceptions import SchulerError
from schuler.recording.io import read

TWO_GB = 2**31
#: Formats whose files are text, or small integers of which none can claim gigabytes.
TEXT = {
    "euroc", "kitti", "kf_gins", "tum", "gnss_ins_sim", "waypoint", "android", "sensor_logger", "phyphox",
    "gpx", "kml", "oan", "text", "csv",
    "pos", "nmea", "psins_imu", "instinct_csv", "folder", "vectornav_lines", "vectornav_csv", "xsens_text",
}  # fmt: skip


def address_space() -> float:
    return int(re.search(r"VmPeak:\s+(\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024


def zeros(wbits: int, n: int = TWO_GB) -> bytes:
    """Deflated zeros: a block that starts from nothing, over and over, so that they need not be packed one by one."""
    step = 1 << 24
    packer = zlib.compressobj(9, zlib.DEFLATED, wbits)
    first = packer.compress(bytes(step)) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(step)) + packer.flush(zlib.Z_FULL_FLUSH)
    return first + block * (n // step - 1) + packer.flush(zlib.Z_FINISH)


def header_line(text: str, label: str) -> str:
    return f"{text:<60}{label}\n"


def rinex() -> Iterator[tuple[str, bytes]]:
    text = samples.module("test_dispatch_satellites").observations()
    yield "a system of 999 types", text.replace("G    2 C1C D1C", "G  999 C1C D1C").encode()
    yield "an epoch of 999 satellites", text.replace("  0  2\n", "  0999\n", 1).encode()
    first = text.encode()[:81]
    yield "gzip of 2 GB", gzip.compress(first) + gzip.compress(bytes(1 << 24)) * 128
    yield "bzip2 of 2 GB", bz2.compress(first) + bz2.compress(bytes(1 << 24)) * 128


def rinex_zip() -> bytes:
    return zipped("rover.obs", b"")


def zipped(name: str, head: bytes) -> bytes:
    """A zip whose one file unpacks to 2 GB of zeros behind a head; it says so."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    data = packer.compress(head) + packer.flush(zlib.Z_FULL_FLUSH) + zeros(-15)
    size = len(head) + TWO_GB
    local = struct.pack("<4s5H3I2H", b"PK\x03\x04", 20, 0, 8, 0, 0, 0, len(data), size, len(name), 0) + name.encode()
    central = struct.pack("<4s6H3I5H2I", b"PK\x01\x02", 20, 20, 0, 8, 0, 0, 0, len(data), size, len(name), 0, 0, 0, 0,
                          0, 0) + name.encode()  # fmt: skip
    end = struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, 1, 1, len(central), len(local) + len(data), 0)
    return local + data + central + end


def npy_head(shape: tuple[int, ...]) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
    return stream.getvalue()


def matlab4() -> Iterator[tuple[str, bytes]]:
    yield "2 GB of doubles", struct.pack("<5i", 0, 2**25, 8, 0, 4) + b"imu\0" + bytes(800)
    yield "a name of 2 GB", struct.pack("<5i", 0, 2, 8, 0, 2**31 - 1) + b"imu\0" + bytes(800)


def matlab5(good: bytes) -> Iterator[tuple[str, bytes]]:
    yield "an element of 2 GB", good[:132] + struct.pack("<I", TWO_GB - 8) + good[136:]
    dims = struct.pack("<II", 5, 8)
    at = good.index(dims) + 8
    yield "a shape of 2 GB", good[:at] + struct.pack("<ii", 2**25, 8) + good[at + 8 :]
    data = zeros(15)
    yield "packed zeros of 2 GB", good[:128] + struct.pack("<II", 15, len(data)) + data
    inner = zlib.compress(good[128:132] + struct.pack("<I", TWO_GB - 8) + good[136:])
    yield "a packed element of 2 GB", good[:128] + struct.pack("<II", 15, len(inner)) + inner


def parquet(folder: Path) -> Iterator[tuple[str, bytes]]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    n = 1 << 20
    table = pa.table({name: pa.array(np.zeros(n)) for name in ("t", "ax", "ay", "az", "gx", "gy", "gz")})
    with pq.ParquetWriter(folder / "z.parquet", table.schema, compression="zstd") as writer:
        for _ in range(40):
            writer.write_table(table)
    yield "40 million rows of zeros", (folder / "z.parquet").read_bytes()


def hdf5(folder: Path) -> Iterator[tuple[str, bytes]]:
    import h5py

    with h5py.File(folder / "z.h5", "w") as file:
        made = file.create_dataset("imu", shape=(TWO_GB // 56, 7), dtype="f8", chunks=(1 << 18, 7), compression="gzip")
        made[: 1 << 18] = 0.0
    yield "a shape of 2 GB", (folder / "z.h5").read_bytes()
    with h5py.File(folder / "z.h5", "w") as file:
        file.create_dataset("imu", data=np.zeros((1 << 22, 7)), chunks=(1 << 18, 7), compression="gzip",
                            compression_opts=9, shuffle=True)  # fmt: skip
    yield "zeros of 235 MB", (folder / "z.h5").read_bytes()


def mcap() -> Iterator[tuple[str, bytes]]:
    import zstandard

    magic = b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 8) + bytes(8)

    def chunk(size: int, compression: bytes, data: bytes) -> bytes:
        body = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(compression)) + compression
        body += struct.pack("<Q", len(data)) + data
        return magic + struct.pack("<BQ", 6, len(body)) + body

    bomb = zstandard.ZstdCompressor(level=3, write_content_size=False).compressobj()
    packed = b"".join(bomb.compress(bytes(1 << 24)) for _ in range(128)) + bomb.flush()
    yield "a record of 2 GB", magic + struct.pack("<BQ", 5, TWO_GB) + bytes(100)
    for size in (1000, 2**30 - 1, TWO_GB, 2**63 - 1):
        yield f"zstd of 2 GB that says {size}", chunk(size, b"zstd", packed)
        yield f"nothing that says {size}", chunk(size, b"zstd", b"\x28\xb5\x2f\xfd" + bytes(20))
        yield f"lz4 that says {size}", chunk(size, b"lz4", b"\x04\x22\x4d\x18" + bytes(30))
    import lz4.frame

    block = lz4.frame.compress(bytes(1 << 28))
    yield "lz4 of 268 MB that says 1000", chunk(1000, b"lz4", block)
    yield "lz4 of 268 MB that says so", chunk(1 << 28, b"lz4", block)


def rosbag(good: bytes) -> Iterator[tuple[str, bytes]]:
    magic = b"#ROSBAG V2.0\n"

    def record(fields: dict[bytes, bytes], data: bytes) -> bytes:
        head = b"".join(struct.pack("<I", len(k) + 1 + len(v)) + k + b"=" + v for k, v in fields.items())
        return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data)) + data

    yield "a header of 2 GB", magic + struct.pack("<I", TWO_GB) + bytes(100)
    yield "data of 2 GB", magic + struct.pack("<I", 8) + struct.pack("<I", 4) + b"op=\x03" + struct.pack("<I", TWO_GB)
    for size in (1000, 2**30 - 1, TWO_GB):
        fields = {b"op": b"\x05", b"compression": b"bz2", b"size": struct.pack("<I", size)}
        begin = good[: chunk_at(good)]
        bomb = bz2.compress(bytes(1 << 24)) * 128
        yield f"bzip2 of 2 GB that says {size}", begin + record(fields, bomb) + good[chunk_end(good) :]
        yield f"bzip2 that says {size}", begin + record(fields, bz2.compress(b"x")) + good[chunk_end(good) :]


def chunk_at(good: bytes) -> int:
    """Where the chunk of a bag begins."""
    at = 13
    while True:
        (n,) = struct.unpack_from("<I", good, at)
        (m,) = struct.unpack_from("<I", good, at + 4 + n)
        if b"op=\x05" in good[at + 4 : at + 4 + n]:
            return at
        at += 8 + n + m


def chunk_end(good: bytes) -> int:
    at = chunk_at(good)
    (n,) = struct.unpack_from("<I", good, at)
    (m,) = struct.unpack_from("<I", good, at + 4 + n)
    return at + 8 + n + m


def crafted(name: str, good: bytes, folder: Path) -> Iterator[tuple[str, bytes]]:
    """Claims made for a format."""
    if name == "rinex_observations":
        yield from rinex()
        yield "zip of 2 GB", rinex_zip()
    elif name == "matlab4":
        yield from matlab4()
    elif name == "matlab5":
        yield from matlab5(good)
    elif name == "npy":
        yield "a shape of 2 GB", npy_head((2**28 // 7, 7)) + bytes(500)
        yield "a shape of 16 EB", npy_head((2**60, 7)) + bytes(500)
    elif name == "npz":
        for label, data in (("a shape of 2 GB", npy_head((2**28 // 7, 7)) + bytes(500)),):
            stream = io.BytesIO()
            with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
                archive.writestr("imu.npy", data)
            yield label, stream.getvalue()
        yield "zeros of 2 GB", zipped("imu.npy", npy_head((2**28 // 7, 7)))
    elif name == "parquet_foreign":
        yield from parquet(folder)
    elif name == "hdf5":
        yield from hdf5(folder)
    elif name == "mcap":
        yield from mcap()
    elif name == "rosbag":
        yield from rosbag(good)
    elif name == "ubx":
        yield "a frame of 65535 bytes", good[:4] + b"\xff\xff" + good[6:]
    elif name == "comma2k19":
        yield "a shape of 2 GB", npy_head((2**28,)) + bytes(500)


def swept(good: bytes) -> Iterator[tuple[str, bytes]]:
    """2 GB and more as four and eight bytes, in both orders, at every place of the header and of the end."""
    n = len(good)
    places = sorted({*range(0, min(n, 200), 3), *range(max(n - 150, 0), n, 5)})
    for k in places:
        order = "big" if k % 4 == 1 else "little"
        yield f"2147483632 at {k}, {order}", good[:k] + (TWO_GB - 16).to_bytes(4, order) + good[k + 4 :]
        if k % 4 == 0:
            yield f"2^31 at {k}", good[:k] + TWO_GB.to_bytes(8, "little") + good[k + 8 :]


def main() -> None:
    warnings.simplefilter("error")
    wanted = sys.argv[1:] or list(samples.ALL)
    results: dict[str, dict[str, float]] = {}
    errors: list[str] = []
    message: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        made = {}
        for format_name in wanted:  # everything is loaded, threads started, before anything is measured
            made[format_name] = samples.make(format_name, Path(name) / format_name)
            read(made[format_name].path, **made[format_name].hints)
        resource.setrlimit(resource.RLIMIT_AS, (int(address_space() * 2**20) + 6 * 2**30, resource.RLIM_INFINITY))
        for format_name, sample in made.items():
            path = sample.damaged[0]
            good = path.read_bytes()
            cases = list(crafted(format_name, good, Path(name)))
            if format_name not in TEXT:
                cases += swept(good)
            results[format_name] = {}
            for label, data in cases:
                path.write_bytes(data)
                before = address_space()
                try:
                    read(sample.path, **sample.hints)
                except SchulerError as error:
                    message[f"{format_name}, {label}"] = str(error)
                except BaseException as error:
                    errors.append(f"{format_name}, {label}: {type(error).__name__}: {str(error)[:200]}")
                results[format_name][label] = address_space() - before
            path.write_bytes(good)
    print(json.dumps({"grown_mb": results, "errors": errors, "said": message}))


if __name__ == "__main__":
    main()
