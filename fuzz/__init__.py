"""Hostile input, made at random: to be refused or read in part, never stumbled over."""
