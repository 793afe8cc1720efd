"""Rows of signals and the messages they are: layout of topics, encoding and decoding."""
