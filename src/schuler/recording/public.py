"""Public recordings that can be fetched: who made them, under which licence, and the bytes that are meant.

Each file is pinned by the commit of its repository and its SHA-256; nothing is fetched unless it is asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from schuler.exceptions import InputError, MissingExtraError
from schuler.recording.io.columns import check_known

HOST = "https://raw.githubusercontent.com"


@dataclass(frozen=True)
class PublicFile:
    """A file of a repository.

    Attributes
    ----------
    path : str
        In the repository; the last part is its name here.
    commit : str
        40 hexadecimal digits.
    sha256 : str
    size : int
        [byte]
    """

    path: str
    commit: str
    sha256: str
    size: int


@dataclass(frozen=True)
class PublicRecording:
    """Files of one run that their makers published.

    Attributes
    ----------
    what : str
    repository : str
        Of GitHub, ``owner/name``.
    licence : str
        As the repository states it.
    files : tuple of PublicFile
    example : str
        A command that works on the folder.
    """

    what: str
    repository: str
    licence: str
    files: tuple[PublicFile, ...]
    example: str

    @property
    def size(self) -> int:
        """All files. [byte]"""
        return sum(file.size for file in self.files)


_NSR = "data/nsr/drive/20201104_091730/20201104_091730"
RECORDINGS = {
    "phone-drive": PublicRecording(
        "Android phone in a car, Stuttgart, 2020-11-04, 999 s: accelerometer and gyroscope at 50 Hz, its fixes at 1 Hz",
        "fedorbaklanov/open-aided-navigation", "MIT",
        (
            PublicFile(f"{_NSR}_Acc.csv", "e2812e8e58e72b579f1db9e650d48d10202d179b",
                       "cefdbed7ba5e04209ac035ef6f07d7f4ff4b4533168af78c34815f951d7f8fc6", 1_956_008),
            PublicFile(f"{_NSR}_Gyro.csv", "e2812e8e58e72b579f1db9e650d48d10202d179b",
                       "3766c6f454c7831ba2c86128d97b9a6137233d5944a9826bad43bd1fe2efd31e", 1_973_582),
            PublicFile(f"{_NSR}_GNSS.csv", "e5e7fe1f14e7a02dfbac2d61ffe5560c1ae1ad40",
                       "58b3cb4ee9e77e32fe7c377087de8664ef60d84a6b1e1cae4da342b707aa22ec", 134_826),
        ),
        "schuler navigate phone-drive --imu MPU-6000",
    ),
    "hand-mpu9150": PublicRecording(
        "two InvenSense MPU-9150 on one rig, turned by hand through about 23 poses, 100 Hz: for free-pose calibration",
        "mikoff/imu-calib", "MIT",
        (
            PublicFile("data/imu0.log", "0d26332d7b870e8f701f46cc1c9694df075eaa03",
                       "b99da3fe9018966b1cd37cb26426f9c0b57be6fe84f33614b649f40246f3de01", 805_740),
            PublicFile("data/imu1.log", "0d26332d7b870e8f701f46cc1c9694df075eaa03",
                       "cfeeed0ae5298d86697fd17884597094b41f341aa061521d0b2d8beca2ae4943", 806_745),
        ),
        "schuler calibrate freepose hand-mpu9150/imu0.log --columns ax,ay,az,gx,gy,gz --units m/s^2,rad/s --rate 100",
    ),
    "laser-gyro": PublicRecording(
        "ring-laser IMU in a parked vehicle, Xi'an, 100 Hz, 1847 s: for noise, quantisation and gyrocompassing",
        "WangShanpeng/PSINS", "BSD-2-Clause",
        (
            PublicFile("data/lasergyro.imu", "452d582100856153d95f759df5cb7771b7f73cbc",
                       "5de921e75f690c91ce6b7d3e811e547e050c4f1d000f648f537a59521206ba4d", 2_665_416),
        ),
        "schuler info laser-gyro/lasergyro.imu",
    ),
}  # fmt: skip


def fetch(name: str, folder: Path | str | None = None, *, host: str | None = None) -> Path:
    """Fetch a public recording; files that are there already, with the right contents, are kept.

    Parameters
    ----------
    name : str
        Of :data:`RECORDINGS`.
    folder : Path or str, optional
        Where its files are put; by default a folder of its name in the working folder.
    host : str, optional
        Mirror of ``https://raw.githubusercontent.com``.

    Returns
    -------
    Path
        The folder.

    Raises
    ------
    MissingExtraError
        If pooch is not installed.
    InputError
        If there is no such recording, the network cannot be reached, or what came is not what is pinned; no file is
        written then.
    """
    recording = RECORDINGS[check_known(name, RECORDINGS, "recording")]
    try:
        import pooch
    except ImportError as error:
        raise MissingExtraError("pooch", "fetch", "fetching public recordings") from error
    pooch.get_logger().setLevel("ERROR")
    target = Path(name) if folder is None else Path(folder)
    for file in recording.files:
        url = f"{host or HOST}/{recording.repository}/{file.commit}/{file.path}"
        own = Path(file.path).name
        if (target / own).exists() and pooch.file_hash(str(target / own)) != file.sha256:
            raise InputError(f"{target / own} is there and is another file: move it away, or fetch into another folder")
        try:
            pooch.retrieve(url, known_hash=f"sha256:{file.sha256}", fname=own, path=target)
        except ValueError as error:
            raise InputError(
                f"{url}: what came is not the file that is pinned (SHA-256 {file.sha256[:12]}...); it was not kept"
            ) from error
        except OSError as error:  # what requests raises is one
            raise InputError(f"{url} cannot be fetched ({type(error).__name__}): is there a network?") from error
    return target
