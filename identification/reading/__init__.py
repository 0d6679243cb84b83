"""Read a file, a DataFrame or arrays into recordings with the names, units and clocks of the log contract."""
