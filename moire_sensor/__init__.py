"""Open fringe-projection 3D sensor: depth from one stereo pair under projected fringes."""
