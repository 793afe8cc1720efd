"""What the claim of a design asks of a run: the loop as designed, its ages, its measured law."""
