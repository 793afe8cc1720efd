"""What a run came to: its cause, assertions, events, and the verdict of all views."""
