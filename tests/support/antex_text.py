"""Text of an ANTEX file with antennas as they are described here."""

import numpy as np


def antex_text(entries):
    """Entries: (type, serial, step of azimuth, {frequency: (offset [mm], variation(zenith, azimuth) [mm, deg])})."""
    rows = [
        labelled("     1.4            M", "ANTEX VERSION / SYST"),
        labelled("A", "PCV TYPE / REFANT"),
        labelled("", "END OF HEADER"),
    ]
    zenith = np.arange(0.0, 91.0, 5.0)
    for name, serial, step, frequencies in entries:
        rows += [labelled("", "START OF ANTENNA"), labelled(f"{name:<20}{serial:<20}", "TYPE / SERIAL NO")]
        rows += [labelled(f"  {step:6.1f}", "DAZI"), labelled("     0.0  90.0   5.0", "ZEN1 / ZEN2 / DZEN")]
        if serial:
            rows.append(labelled("  2020     1     1     0     0    0.0000000", "VALID FROM"))
        for code, (offset, variation) in frequencies.items():
            rows.append(labelled(f"   {code}", "START OF FREQUENCY"))
            rows.append(labelled("".join(f"{v:10.2f}" for v in offset), "NORTH / EAST / UP"))
            rows.append("   NOAZI" + "".join(f"{variation(z, 0.0):8.2f}" for z in zenith))
            for a in np.arange(0.0, 361.0, step) if step else ():
                rows.append(f"{a:8.1f}" + "".join(f"{variation(z, a):8.2f}" for z in zenith))
            rows.append(labelled(f"   {code}", "END OF FREQUENCY"))
        rows.append(labelled("", "END OF ANTENNA"))
    return "\n".join([*rows, ""])


def labelled(text, label):
    return f"{text:<60}{label}"
