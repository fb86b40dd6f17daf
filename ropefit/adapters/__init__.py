"""Between artifacts and models: setups, data, units, values, and models made again from files."""
