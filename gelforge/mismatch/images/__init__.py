"""Optical flow of image regions as further readings."""
