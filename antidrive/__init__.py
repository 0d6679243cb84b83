"""antidrive"""
