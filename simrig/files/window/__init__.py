"""BSDF files in XML of WINDOW (LBNL) and Radiance: Klems matrices and tensor trees."""
