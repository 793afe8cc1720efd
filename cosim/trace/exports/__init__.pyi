from .export import WrittenTable as WrittenTable
