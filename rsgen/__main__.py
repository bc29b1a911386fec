"""``python -m rsgen`` is the command ``rsgen``."""

from __future__ import annotations

from rsgen.app.cli import main

if __name__ == "__main__":
    main()
