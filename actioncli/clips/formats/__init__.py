"""One reader a file format; each turns a path into a `Recording` and decides nothing else.

A reader is imported when a file of its kind is met, so that reading an array costs numpy alone.
"""
