"""What everything runs on: kernels, threads, interrupts, room on disk, names of array types."""
