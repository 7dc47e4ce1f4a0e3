"""Decoders of streams: the parsers that read files, fed piece by piece.

A decoder has ``feed(data, arrival)``, which returns the messages that a piece of a stream completes; ``pause()``,
called when nothing has come for a while; ``finish()`` at the end of a stream; and ``left_out``, which counts what was
of no use by a phrase that says why. Fed a file in pieces of any length it gives what reading the file gives.
"""
