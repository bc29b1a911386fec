"""What every package uses: errors, arrays, findings, verdicts, files, tables, limits of a process."""
