"""From sensor data to ordered centrelines."""
