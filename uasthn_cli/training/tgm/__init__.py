"""Thermal generation (the paper's TGM): satellite colours to thermal grey, by pix2pix."""
