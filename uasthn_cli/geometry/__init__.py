"""Pure mathematics: corners and homographies, pixel centres, camera and attitude, the earth."""
