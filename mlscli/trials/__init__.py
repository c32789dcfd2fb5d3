"""The program tried: what a build would do, what each stage is worth, how long a batch takes."""
