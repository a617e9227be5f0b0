"""Entry points of the executables."""
