"""What is simulated: pure mathematics, no FMI, no files."""
