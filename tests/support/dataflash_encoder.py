"""Writer of DataFlash logs for the tests; shares no code with the reader."""

import struct

LETTERS = {"Q": "Q", "B": "B", "b": "b", "H": "H", "h": "h", "I": "I", "i": "i", "f": "f", "d": "d", "c": "h", "C": "H",
           "e": "i", "E": "I", "L": "i", "Z": "64s", "N": "16s", "n": "4s", "M": "B", "q": "q"}  # fmt: skip
FACTORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}

#: Number, letters and labels of messages as ArduPilot 4.x writes them.
MESSAGES = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "IMU": (133, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "ACC": (134, "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
    "GYR": (135, "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
    "GPS": (130, "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U"),
    "GPA": (131, "QBCCCCfBIHeHH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,AEl,RTCMFU,RTCMFD"),
    "GPAU": (132, "QBCCCCfBIHfHH", "TimeUS,I,VDop,HAcc,VAcc,SAcc,YAcc,VV,SMS,Delta,Und,RTCMFU,RTCMFD"),
    "BARO": (136, "QBffcfIfffB", "TimeUS,I,Alt,Press,Temp,CRt,SMS,Offset,GndTemp,Wind,H"),
    "ATT": (137, "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "POS": (138, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt"),
    "XKF1": (139, "QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"),
    "MSG": (140, "QZ", "TimeUS,Message"),
}


def layout(letters: str) -> str:
    return "<" + "".join(LETTERS[letter] for letter in letters)


def describe(name: str) -> bytes:
    """The FMT message of a kind."""
    number, letters, labels = MESSAGES[name]
    body = struct.pack("<BB4s16s64s", number, 3 + struct.calcsize(layout(letters)), shown(name), letters.encode(),
                       labels.encode())  # fmt: skip
    return b"\xa3\x95\x80" + body


def shown(name: str) -> bytes:
    return (b"GPA" if name == "GPAU" else name.encode())[:4]


def message(name: str, *values) -> bytes:
    """One message; numbers of scaled letters are given in units, missing ones are zero."""
    number, letters, _ = MESSAGES[name]
    full = [*values, *([0] * (len(letters) - len(values)))]
    packed = []
    for letter, value in zip(letters, full, strict=True):
        if letter in FACTORS:
            packed.append(round(value * FACTORS[letter]))
        elif letter in "ZNn":
            packed.append(value if isinstance(value, bytes) else b"")
        else:
            packed.append(float(value) if letter in "fd" else int(value))
    return b"\xa3\x95" + bytes([number]) + struct.pack(layout(letters), *packed)


def log(messages: list[bytes], names: tuple[str, ...]) -> bytes:
    """A log: descriptions, then messages."""
    return b"".join([describe("FMT"), *(describe(n) for n in names), *messages])
