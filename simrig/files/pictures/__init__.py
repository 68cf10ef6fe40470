"""Reading pictures: what a file says about its values is used, or the file is refused."""

from simrig.files.pictures.picture import LARGEST_IMAGE, Picture, as_image
from simrig.files.pictures.reader import (
    is_picture,
    names_picture,
    picture_format,
    read_image,
    read_picture,
)

__all__ = [
    "LARGEST_IMAGE",
    "Picture",
    "as_image",
    "is_picture",
    "names_picture",
    "picture_format",
    "read_image",
    "read_picture",
]
