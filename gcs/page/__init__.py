"""What the browser loads: the page, its modules and style, and the library that draws its plots."""
