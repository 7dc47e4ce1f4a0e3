"""Events of a live run: repeated ones are counted and the number is said with the next."""

from schuler.live.events import EventLog


def test_repeated_events_are_counted_and_others_are_not():
    log = EventLog()
    given = [log.add(t, "late", "a fix is late", "late") for t in (0.0, 1.0, 2.0, 9.0)]
    assert [e is not None for e in given] == [True, False, False, False]
    assert log.add(3.0, "measurement", "another", "other").text == "another"
    assert log.add(11.0, "late", "a fix is late", "late").text == "a fix is late (3 more like the last one since)"
    assert log.add(30.0, "late", "a fix is late", "late").text == "a fix is late"
    # health is said every time
    assert all(log.add(t, "health", "ok becomes coasting", "health") is not None for t in (30.0, 31.0))
    assert len(log.newest) == 6
