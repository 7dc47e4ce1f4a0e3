"""Which message, which clock, when the signal left; group delays by signal."""

import numpy as np
import pytest

from schuler.exceptions import InputError
from schuler.gnss.ephemerides import (
    B2B_SOURCE,
    NEWER_SOURCE,
    Ephemerides,
    GlonassRecords,
    KeplerRecords,
    no_glonass,
    no_kepler,
)
from schuler.gnss.satellites import (
    MAX_AGE_S,
    choose_messages,
    group_delays,
    is_b2b,
    is_f_nav,
    is_newer,
    satellite_states,
    transmission_times,
)
from schuler.gnss.signals import SPEED_OF_LIGHT, satellite

EPOCH = 1.3e9


def kepler(*messages):
    """Messages from dicts; toe, toc and sent relative to EPOCH."""
    rows = []
    for message in messages:
        values = dict.fromkeys(KeplerRecords.__dataclass_fields__, 0.0)
        values |= {"sqrt_a": 5153.6, "e": 0.01, "i0": 0.96, "m0": 0.3, "group_delay": (5e-9, np.nan)}
        values |= {"sent": np.nan, "accuracy": 2.0} | message
        values["sat"] = satellite(values["sat"])
        values["toe"] += EPOCH
        values["toc"] = EPOCH + message.get("toc", message.get("toe", 0.0))
        values["sent"] += EPOCH
        rows.append(values)
    records = KeplerRecords(**{k: np.array([row[k] for row in rows]) for k in KeplerRecords.__dataclass_fields__})
    return Ephemerides(records, no_glonass())


def glonass(*toes, **values):
    n = len(toes)
    zero = np.zeros(n)
    r = {"sat": zero + 105, "toe": EPOCH + np.array(toes), "sent": zero + np.nan, "r_e": np.tile([2.5e7, 0, 0], (n, 1)),
         "v_e": np.tile([0, 0, 3950.0], (n, 1)), "a_e": np.zeros((n, 3)), "clock": zero, "rate": zero, "channel": zero,
         "health": zero} | values  # fmt: skip
    return Ephemerides(no_kepler(), GlonassRecords(**r))


def chosen(ephemerides, sat, t, **options):
    t = np.atleast_1d(np.asarray(t, dtype=float))
    sat = np.full(t.shape, satellite(sat))
    return choose_messages(ephemerides, sat, t, epoch_gps_s=EPOCH, **options).tolist()


def test_the_nearest_reference_time_counts():
    e = kepler(*({"sat": "G05", "toe": toe} for toe in (7200.0, 0.0, 14_400.0)), {"sat": "G06", "toe": 3600.0})
    assert chosen(e, "G05", [-100.0, 3599.0, 3601.0, 10_799.0, 10_801.0]) == [1, 1, 0, 0, 2]
    assert chosen(e, "G07", [0.0]) == [-1]


def test_brute_force_agrees(rng):
    """Random messages of one satellite, causal or not, against the definition."""
    toe = np.round(rng.uniform(0.0, 4e4, 40) / 600.0) * 600.0
    sent = toe - rng.uniform(-600.0, 7200.0, 40)
    e = kepler(*({"sat": "G05", "toe": a, "sent": b} for a, b in zip(toe, sent, strict=True)))
    t = rng.uniform(-5e3, 5e4, 500)
    for causal in (False, True):
        choice = chosen(e, "G05", t, causal=causal, max_age_s={"G": 3000.0})
        for one, row in zip(t, choice, strict=True):
            distance = np.where((sent <= one) | (not causal), np.abs(one - toe), np.inf)
            if distance.min() > 3001.0:
                assert row == -1
            else:
                assert distance[row] == pytest.approx(distance.min(), abs=1e-6)  # epoch arithmetic
                same = np.flatnonzero((toe == toe[row]) & np.isfinite(distance))
                assert sent[row] == sent[same].max()


@pytest.mark.parametrize("letter", ["G", "E", "C", "J", "R"])
def test_messages_expire(letter):
    e = glonass(0.0) if letter == "R" else kepler({"sat": f"{letter}05", "toe": 0.0})
    limit = MAX_AGE_S[letter]
    assert chosen(e, f"{letter}05", [-limit, limit, limit + 2.0, -limit - 2.0]) == [0, 0, -1, -1]
    assert chosen(e, f"{letter}05", [900.0], max_age_s={letter: 600.0}) == [-1]


def test_a_causal_choice_waits_for_the_message():
    e = kepler({"sat": "G05", "toe": 0.0, "sent": -7000.0}, {"sat": "G05", "toe": 7200.0, "sent": 4000.0})
    assert chosen(e, "G05", [3700.0, 3999.0, 4000.0, 5000.0]) == [1, 1, 1, 1]
    assert chosen(e, "G05", [3700.0, 3999.0, 4000.0, 5000.0], causal=True) == [0, 0, 1, 1]
    assert chosen(e, "G05", [-7100.0], causal=True) == [-1]
    # where the file does not say: GPS two hours ahead, Galileo at its reference time
    assert chosen(kepler({"sat": "G05", "toe": 0.0}), "G05", [-7199.0], causal=True) == [0]
    assert chosen(kepler({"sat": "E05", "toe": 0.0}), "E05", [-1.0, 0.0], causal=True) == [-1, 0]


def test_an_unhealthy_message_is_not_passed_over():
    e = kepler({"sat": "G05", "toe": 0.0}, {"sat": "G05", "toe": 7200.0, "health": 63})
    s = satellite_states(e, [5, 5, 9], [3000.0, 5000.0, 0.0], epoch_gps_s=EPOCH)
    assert s.has_message.tolist() == [True, True, False]
    assert s.healthy.tolist() == [True, False, False]
    assert s.record.tolist() == [0, 1, -1]
    assert np.isnan(s.r_e[2]).all()
    assert np.isnan(s.clock[2])


def test_galileo_messages_by_their_kind():
    e = kepler(
        {"sat": "E05", "toe": 0.0, "source": 0b101 | 0x200},
        {"sat": "E05", "toe": 0.0, "source": 0b010 | 0x100},
        {"sat": "E05", "toe": 1200.0, "source": 0b101 | 0x200},
        {"sat": "E06", "toe": 0.0, "source": 0b010 | 0x100},
        {"sat": "E07", "toe": 0.0, "source": 0b111 | 0x100},
        {"sat": "E08", "toe": 0.0, "source": 0},
        {"sat": "E09", "toe": 0.0, "source": 0b010},
        {"sat": "G01", "toe": 0.0, "source": 0b010 | 0x100},
    )
    assert is_f_nav(e.kepler).tolist() == [False, True, False, True, True, False, True, False]
    assert chosen(e, "E05", [100.0, 900.0]) == [0, 2]
    assert chosen(e, "E05", [100.0, 900.0], f_nav=True) == [1, 1]
    assert chosen(e, "E05", [100.0, 900.0], f_nav=[True, False]) == [1, 2]
    assert chosen(e, "E06", [100.0]) == [3]  # the other kind rather than none
    assert chosen(e, "E08", [100.0], f_nav=True) == [5]


@pytest.mark.parametrize("sat", ["G05", "J02", "C21"])
def test_newer_messages_where_asked_for_or_alone(sat):
    """The nearest of the older kind, unless the newer is asked for; the other kind rather than none."""
    e = kepler(
        {"sat": sat, "toe": 0.0}, {"sat": sat, "toe": 600.0, "source": NEWER_SOURCE}, {"sat": sat, "toe": 1200.0},
        {"sat": sat, "toe": 9000.0, "source": NEWER_SOURCE},
    )  # fmt: skip
    assert is_newer(e.kepler).tolist() == [False, True, False, True]
    assert chosen(e, sat, [500.0, 700.0, 9500.0]) == [0, 2, 3]
    assert chosen(e, sat, [500.0, 700.0, 9500.0], f_nav=True) == [1, 1, 3]


def test_the_message_of_b2b_where_asked_for_and_nowhere_else():
    """Nearest of its own kind, else the older and the newer; B1I never takes it, whose delay it does not have."""
    e = kepler(
        {"sat": "C21", "toe": 0.0}, {"sat": "C21", "toe": 600.0, "source": B2B_SOURCE}, {"sat": "C21", "toe": 1200.0},
        {"sat": "C22", "toe": 0.0, "source": B2B_SOURCE}, {"sat": "C23", "toe": 0.0, "source": NEWER_SOURCE},
    )  # fmt: skip
    assert is_newer(e.kepler).tolist() == [False, False, False, False, True]
    assert chosen(e, "C21", [500.0, 1100.0]) == [0, 2]
    assert chosen(e, "C21", [500.0, 1100.0], f_nav=True) == [0, 2]
    assert chosen(e, "C21", [500.0, 1100.0, 4500.0], b2b=True) == [1, 1, 2]
    assert chosen(e, "C21", [1100.0, 1100.0], b2b=[False, True]) == [2, 1]
    assert chosen(e, "C22", [0.0]) == chosen(e, "C22", [0.0], f_nav=True) == [-1]
    assert chosen(e, "C22", [0.0], b2b=True) == [3]
    assert chosen(e, "C23", [0.0], b2b=True) == [4]


def test_clock_polynomial_and_its_rate():
    e = kepler({"sat": "G05", "toe": 0.0, "toc": 100.0, "af0": 1e-4, "af1": 2e-11, "af2": 3e-18, "e": 0.0})
    t = np.array([-3000.0, 100.0, 4000.0])
    s = satellite_states(e, [5, 5, 5], t, epoch_gps_s=EPOCH)
    assert np.allclose(s.clock, 1e-4 + 2e-11 * (t - 100.0) + 3e-18 * (t - 100.0) ** 2, rtol=1e-14, atol=0.0)
    assert np.allclose(s.clock_rate, 2e-11 + 6e-18 * (t - 100.0), rtol=1e-12, atol=0.0)


def test_the_relativistic_term_has_its_known_size():
    """Eccentricity 0.01 at a quarter turn from perigee: 23 ns; a clock runs late from perigee on."""
    e = kepler({"sat": "G05", "toe": 0.0, "m0": np.pi / 2.0 - 0.01})
    s = satellite_states(e, [5], [0.0], epoch_gps_s=EPOCH)
    assert s.clock[0] == pytest.approx(-4.442807633e-10 * 0.01 * 5153.6, rel=1e-3)


def test_the_glonass_clock_is_a_line():
    e = glonass(0.0, clock=[1e-4], rate=[1e-12])
    s = satellite_states(e, [105, 105], [0.0, 600.0], epoch_gps_s=EPOCH)
    assert np.allclose(s.clock, [1e-4, 1e-4 + 6e-10], rtol=1e-14, atol=0.0)
    assert np.array_equal(s.clock_rate, [1e-12, 1e-12])
    assert s.healthy.all()


@pytest.mark.parametrize("sat", ["G05", "R05"])
def test_time_of_transmission_closes(sat):
    """``c (t_received - shown)`` is the pseudorange, ``shown`` being the satellite's own clock at transmission."""
    e = kepler({"sat": "G05", "toe": 0.0, "af0": 9e-4, "af1": 1e-11, "e": 0.0}) if sat == "G05" else glonass(
        0.0, clock=[9e-4], rate=[1e-11]
    )  # fmt: skip
    number = np.array([satellite(sat)])
    pseudorange = np.array([2.3e7])
    t = transmission_times(e, number, np.array([1000.0]), pseudorange, np.array([0]), epoch_gps_s=EPOCH)
    clock = satellite_states(e, number, t, epoch_gps_s=EPOCH).clock
    assert SPEED_OF_LIGHT * (1000.0 - (t + clock))[0] == pytest.approx(2.3e7, abs=1e-4)  # rounding of 1000 s


def test_wrong_shapes_are_refused():
    with pytest.raises(InputError, match="one shape"):
        choose_messages(kepler({"sat": "G05"}), [5, 5], [0.0])


def delays(message, *bands):
    e = kepler({"sat": "G05", "toe": 0.0} | message)
    n = len(bands)
    sat = np.full(n, e.kepler.sat[0])
    s = satellite_states(e, sat, np.zeros(n), epoch_gps_s=EPOCH, b2b=is_b2b(e.kepler)[0])
    return group_delays(s, sat, np.array(bands))


def free_of_delay(first, second, f1, f2):
    return (f1**2 * first - f2**2 * second) / (f1**2 - f2**2)


def test_gps_delays_cancel_in_the_pair_of_its_clock():
    delay, is_stated = delays({"group_delay": (5e-9, np.nan)}, 1, 2, 5)
    assert delay[0] == 5e-9
    assert delay[1] == pytest.approx(5e-9 * (77.0 / 60.0) ** 2, rel=1e-12)
    assert abs(free_of_delay(delay[0], delay[1], 1575.42, 1227.6)) < 1e-22  # rounding
    assert is_stated.tolist() == [True, True, False]


def test_galileo_delays_cancel_in_the_pair_of_the_message():
    """From either message the same clock of E1: I/NAV minus BGD of E5b, F/NAV minus BGD of E5a."""
    both = {"sat": "E05", "group_delay": (4e-9, 7e-9)}
    i_nav, is_stated = delays(both | {"source": 0x205}, 1, 5, 7, 8)
    assert is_stated.all()
    assert i_nav[0] == 7e-9
    assert abs(free_of_delay(i_nav[0], i_nav[2], 1575.42, 1207.14)) < 1e-22
    # E1/E5a from the clock of E1/E5b: their difference is that of the two delays
    assert free_of_delay(i_nav[0], i_nav[1], 1575.42, 1176.45) == pytest.approx(7e-9 - 4e-9, rel=1e-9)
    f_nav, is_stated = delays({"sat": "E05", "group_delay": (4e-9, 0.0), "source": 0x102}, 1, 5, 7)
    assert f_nav[0] == 4e-9
    assert abs(free_of_delay(f_nav[0], f_nav[1], 1575.42, 1176.45)) < 1e-22
    assert is_stated.tolist() == [True, True, False]


def test_beidou_delays():
    delay, is_stated = delays({"sat": "C14", "group_delay": (3e-9, -2e-9)}, 2, 7, 6, 1, 5)
    assert delay.tolist() == [3e-9, -2e-9, 0.0, 3e-9, 0.0]
    assert is_stated.tolist() == [True, True, True, False, False]


def test_b2b_has_a_delay_by_its_own_message_only():
    """A satellite of the third generation repeats B1I's delay where others have that of B2I."""
    delay, is_stated = delays({"sat": "C20", "group_delay": (3e-9, 3e-9)}, 2, 7, 6)
    assert delay.tolist() == [3e-9, 0.0, 0.0]
    assert is_stated.tolist() == [True, False, True]
    delay, is_stated = delays({"sat": "C20", "group_delay": (np.nan, -2e-9), "source": B2B_SOURCE}, 7, 6, 2, 1, 5)
    assert delay.tolist() == [-2e-9, 0.0, 0.0, 0.0, 0.0]
    assert is_stated.tolist() == [True, True, False, False, False]


def test_delays_of_newer_messages():
    """L5 by its ISC; B1C and B2a, but no B1I."""
    delay, is_stated = delays({"group_delay": (5e-9, 2e-9), "source": NEWER_SOURCE}, 1, 2, 5)
    assert delay[[0, 2]].tolist() == [5e-9, 2e-9]
    assert is_stated.tolist() == [True, True, True]
    delay, is_stated = delays({"sat": "C20", "group_delay": (3e-9, -2e-9), "source": NEWER_SOURCE}, 1, 5, 6, 2, 7)
    assert delay.tolist() == [3e-9, -2e-9, 0.0, 3e-9, 0.0]
    assert is_stated.tolist() == [True, True, True, False, False]


def test_what_is_not_broadcast_is_zero_and_unknown():
    delay, is_stated = delays({"group_delay": (np.nan, np.nan)}, 1, 2)
    assert delay.tolist() == [0.0, 0.0]
    assert is_stated.tolist() == [False, False]
    s = satellite_states(glonass(0.0), [105], [0.0], epoch_gps_s=EPOCH)
    assert group_delays(s, np.array([105]), np.array([1]))[0].tolist() == [0.0]
