"""Measurements that take long, run by name: each prints a table and writes JSON."""
