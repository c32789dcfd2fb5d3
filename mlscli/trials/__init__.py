"""Trials of the program: what a build would do, what each stage is worth, how long batches take."""
