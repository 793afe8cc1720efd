"""An MCAP file: its records as bytes, walked and indexed when read, laid out and written."""
