"""Shows turtlesim's picture in a window, on a web page or in the terminal.

Start with `views`, which chooses one of `window`, `web_view` and `terminal`. `raster` and `tiles`
are pure and compute what the terminal and the page get. Nothing here moves turtles.
"""
