"""Shows results: on the console, as plots, as files and as an HTML page.

An answer becomes a `Document` (``plan_document(plan)``), and the document is shown:
``rich.print(rendered(document))`` or `write_document`. Plots are SVG elements.

Names are imported when they are first used: a table needs no Matplotlib.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
