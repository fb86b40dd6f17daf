"""The four primary losses of the paper and their combinations OBJ1-OBJ9."""
