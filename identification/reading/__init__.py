"""From a file, a DataFrame or arrays to recordings with the names, units and clocks of the log contract."""
