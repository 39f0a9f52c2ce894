"""Everything that a lecture needs: labs, scenes, the class, and notebooks.

Start with `labs`, which has the exercises and their checks. `scenes` plays typical mistakes,
`browser_lab` runs labs in a browser tab, `classroom` connects the laptops of a class, and
`notebook` is for Jupyter. Nothing that a robot or an operator uses may depend on this district.
"""
