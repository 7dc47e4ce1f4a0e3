"""Text of an IONEX file whose contents are a function of place and time."""

import numpy as np

from schuler.timebase import calendar


def ionex_text(
    t, content, *, rms=None, lat=(87.5, -87.5, -2.5), lon=(-180.0, 180.0, 5.0), exponent=-1, mapping="COSZ", leap=18.0
):
    """Maps at GPS times; ``content(lat, lon, t)`` and ``rms`` in TECU of degrees; NaN is no value."""
    rows = [labelled("     1.0            IONOSPHERE MAPS     GNSS", "IONEX VERSION / TYPE")]
    rows += [labelled(f"  {mapping}", "MAPPING FUNCTION"), labelled("  6371.0", "BASE RADIUS")]
    rows += [labelled("     2", "MAP DIMENSION"), labelled(numbers(450.0, 450.0, 0.0), "HGT1 / HGT2 / DHGT")]
    rows += [labelled(numbers(*lat), "LAT1 / LAT2 / DLAT"), labelled(numbers(*lon), "LON1 / LON2 / DLON")]
    rows += [labelled(f"{exponent:6d}", "EXPONENT"), labelled("", "END OF HEADER")]
    for kind, of in (("TEC", content), ("RMS", rms)):
        for k, when in enumerate(t if of else ()):
            rows.append(labelled(f"{k + 1:6d}", f"START OF {kind} MAP"))
            d = calendar(when - leap)
            date = (d.year, d.month, d.day, d.hour, d.minute, d.second)
            rows.append(labelled("".join(f"{x:6d}" for x in date), "EPOCH OF CURRENT MAP"))
            places = np.arange(lon[0], lon[1] + 0.5 * lon[2], lon[2])
            for one in np.arange(lat[0], lat[1] + 0.5 * lat[2], lat[2]):
                rows.append(labelled("  " + numbers(one, *lon, 450.0)[2:], "LAT/LON1/LON2/DLON/H"))
                values = [of(one, x, when) / 10.0**exponent for x in places]
                text = [f"{9999 if np.isnan(v) else round(v):5d}" for v in values]
                rows += ["".join(text[i : i + 16]) for i in range(0, len(text), 16)]
            rows.append(labelled(f"{k + 1:6d}", f"END OF {kind} MAP"))
    return "\n".join([*rows, labelled("", "END OF FILE"), ""])


def numbers(*values):
    return "  " + "".join(f"{v:6.1f}" for v in values)


def labelled(text, label):
    return f"{text:<60}{label}"
