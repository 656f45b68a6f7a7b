"""CropTTA views, homography consensus, spread, and the decision to accept."""
