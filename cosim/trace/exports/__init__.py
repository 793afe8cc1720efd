"""Tables in the files of other tools: CSV, Parquet, MATLAB."""
