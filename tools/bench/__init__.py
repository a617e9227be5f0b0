"""Accuracy and speed of the methods beside their peers, one run: ``make bench``."""
