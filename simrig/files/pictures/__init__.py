"""Reading pictures: what a file says about its values is used, or the file is refused."""

from simrig.files.pictures.picture import LARGEST_IMAGE, Picture, as_image
from simrig.files.pictures.reader import (
    names_picture,
    picture_format,
    read_image,
    read_picture,
)

__all__ = [
    "LARGEST_IMAGE",
    "Picture",
    "as_image",
    "names_picture",
    "picture_format",
    "read_image",
    "read_picture",
]
