"""Networks that regress how far the thermal image's corners are from the satellite image's.

The paper's DHN, IHN and STHN, numerically as published: satellite features lie on the query grid
and thermal features are looked up, because published weights were trained so.
"""
