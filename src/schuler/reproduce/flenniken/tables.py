"""Chapter 2: tables of sensors and grades."""

from __future__ import annotations

from schuler.reproduce.cells import Cell, claimed, digits, shown, transcribed
from schuler.reproduce.items import Effort, Item, Outcome
from schuler.units import DEG, DEG_PER_HR, DEG_PER_RTHR, G0, PERCENT, PPM, UG

_GRADES = ("consumer", "automotive", "tactical")
#: Table 2.1: white noise [ug/sqrt(Hz)], scale factor [ppm], bias [ug], range [g].
_ACCELEROMETERS = {
    "LN-200": ("50", "300", "50", "40"),
    "HG1700-flenniken": ("30", "300", "50.00", "50"),
    "HG1900-flenniken": ("30", "300", "1", "70"),
}
#: Table 2.3: unit of the noise, noise (the upper of two), unit of the scale factor, scale factor, bias [deg/h], range
#: [deg/s].
_GYROSCOPES = {
    "LN-200": ("deg/sqrt(h)", "0.10", "ppm", "100", "0.35", "1000"),
    "HG1700-flenniken": ("deg/sqrt(h)", "0.300", "ppm", "150", "2.00", "1000"),
    "HG1900-flenniken": ("deg/sqrt(h)", "0.1", "ppm", "150", "10.0", "1000"),
    "KVH-5000": ("deg/sqrt(h)", "0.083", "ppm", "1000", "1.00", "500"),
    "Systron-Donner": ("deg/sqrt(h)", "0.33", "%", "0.5", "90.00", "100"),
    "AQRS-000640-104": ("deg/s/sqrt(Hz)", "0.025", "%", "3", "180.00", "64"),
    "AQRS-000640-109": ("deg/s/sqrt(Hz)", "0.025", "%", "5", "180.00", "75"),
}
_UNITS = {"deg/sqrt(h)": DEG_PER_RTHR, "deg/s/sqrt(Hz)": DEG, "ppm": PPM, "%": PERCENT}
#: Tables 2.2 and 2.4: white noise [g/sqrt(Hz)], time [s], bias [g]; [deg/s/sqrt(Hz)], [s], [deg/h].
_ACCEL_GRADES = {
    "consumer": (".003", "100", "2.4e-3"),
    "automotive": (".001", "100", "1.2e-3"),
    "tactical-printed": (".0005", "60", "50e-5"),
}
_GYRO_GRADES = {
    "consumer": (".05", "300", "360"), "automotive": (".05", "300", "180"), "tactical": (".0017", "100", "0.35"),
}  # fmt: skip


def accelerometers(effort: Effort) -> Outcome:
    """Table 2.1."""
    from schuler.sensors.catalogue import triad

    cells: list[Cell] = []
    for name, (noise, scale, bias, reach) in _ACCELEROMETERS.items():
        t = triad(name, "accel")
        cells += [
            digits(f"{name}: white noise", noise, t.random_walk / UG, unit="ug/sqrt(Hz)"),
            digits(f"{name}: scale factor", scale, t.scale_factor / PPM, unit="ppm"),
            digits(f"{name}: bias variation", bias, (t.in_run_bias or t.bias_instability) / UG, unit="ug"),
            digits(f"{name}: range", reach, (t.range or 0.0) / G0, unit="g"),
        ]
    reason = (
        "The HG-1900's 1 ug is held for a slip of unit: it would be fifty times better than the HG-1700, and the "
        "maker's sheet has 1 mg, which the catalogue holds."
    )
    return Outcome(transcribed(*cells), reason)


def gyroscopes(effort: Effort) -> Outcome:
    """Table 2.3."""
    from schuler.sensors.catalogue import triad

    cells: list[Cell] = []
    for name, (noise_unit, noise, scale_unit, scale, bias, reach) in _GYROSCOPES.items():
        t = triad(name, "gyro")
        in_run = t.in_run_bias or t.bias_instability
        cells += [
            digits(f"{name}: white noise", noise, t.random_walk / _UNITS[noise_unit], unit=noise_unit),
            digits(f"{name}: scale factor", scale, t.scale_factor / _UNITS[scale_unit], unit=scale_unit),
            digits(f"{name}: bias variation", bias, in_run / DEG_PER_HR, unit="deg/h"),
            digits(f"{name}: range", reach, (t.range or 0.0) / DEG, unit="deg/s"),
        ]
    return Outcome(transcribed(*cells), "Where a range is printed the catalogue holds its upper end.")


def accelerometer_grades(effort: Effort) -> Outcome:
    """Table 2.2."""
    from schuler.sensors.catalogue import triad

    cells: list[Cell] = []
    for name, (noise, time, bias) in _ACCEL_GRADES.items():
        t = triad(f"flenniken-{name}", "accel")
        cells += [
            digits(f"{name}: white noise", f"0{noise}", t.random_walk / G0, unit="g/sqrt(Hz)"),
            digits(f"{name}: time constant", time, t.in_run_time, unit="s"),
            digits(f"{name}: bias variation", bias, t.in_run_bias / G0, unit="g"),
        ]
    t = triad("flenniken-tactical", "accel")
    cells += [
        digits("tactical, as the LN-200 of Table 2.1: white noise", "50e-6", t.random_walk / G0, unit="g/sqrt(Hz)",
               reference="corrected"),
        digits("tactical, as the LN-200 of Table 2.1: bias variation", "50e-6", t.in_run_bias / G0, unit="g",
               reference="corrected"),
    ]  # fmt: skip
    reason = (
        "The tactical row is ten times that of the LN-200 it stands for: chapter 3 is met with the LN-200's numbers, "
        "the scatter of chapter 7 with the printed ones. Both are kept."
    )
    return Outcome(transcribed(*cells), reason)


def gyroscope_grades(effort: Effort) -> Outcome:
    """Table 2.4."""
    from schuler.sensors.catalogue import triad

    cells: list[Cell] = []
    for name, (noise, time, bias) in _GYRO_GRADES.items():
        t = triad(f"flenniken-{name}", "gyro")
        cells += [
            digits(f"{name}: white noise", f"0{noise}", t.random_walk / DEG, unit="deg/s/sqrt(Hz)"),
            digits(f"{name}: time constant", time, t.in_run_time, unit="s"),
            digits(f"{name}: bias variation", bias, t.in_run_bias / DEG_PER_HR, unit="deg/h"),
        ]
    return Outcome(transcribed(*cells))


def categories(effort: Effort) -> Outcome:
    """Section 2.8: sensors compared with the tables."""
    from schuler.sensors import grade
    from schuler.sensors.catalogue import entry, spec, triad
    from schuler.sensors.spec import ImuSpec, TriadSpec

    own = sum(grade(spec(f"flenniken-{name}")).grade == name for name in _GRADES)
    none = TriadSpec(random_walk=0.0)
    verdicts = {
        name: grade(ImuSpec(name, gyro=triad(name, "gyro"), accel=none)).gyro
        for name in ("LN-200", "KVH-5000-measured", "AQRS-104", "AQRS-104-measured")
    }
    cells = [
        claimed(
            "grades that the rule finds of their own row", "three grades with numbers", float(own), low=3.0, high=3.0
        ),
        *(
            shown(f"{name}: grade (0 {_GRADES[0]}, 1 {_GRADES[1]}, 2 {_GRADES[2]})", float(_GRADES.index(str(v.grade))))
            for name, v in verdicts.items()
        ),
        digits("price, tactical", "20", entry("flenniken-tactical").printed["price_usd"] / 1e3, unit="1000 US$"),
        digits(
            "price, consumer: below", "1", entry("flenniken-consumer").printed["price_usd_below"] / 1e3, unit="1000 US$"
        ),
    ]
    reason = (
        "The thesis prints tables but no rule: ours is the nearest grade of each attribute in logarithms and the worst "
        "of these. Navigation grade is named without numbers."
    )
    return Outcome(transcribed(*cells), reason)


ITEMS = (
    Item("table-2.1", "Accelerometers", "exact", accelerometers),
    Item("table-2.2", "Grades of accelerometers", "exact", accelerometer_grades),
    Item("table-2.3", "Gyroscopes", "exact", gyroscopes),
    Item("table-2.4", "Grades of gyroscopes", "exact", gyroscope_grades),
    Item("text-2.8", "Which grade a sensor is of", "exact", categories),
)
