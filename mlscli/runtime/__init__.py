"""What everything runs on: kernels, threads, interrupts, temporary files, array types."""
