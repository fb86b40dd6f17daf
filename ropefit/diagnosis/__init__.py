"""What was left out: score scan, evidence, full fits, held-out blocks."""
